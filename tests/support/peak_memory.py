"""How much memory a call takes, though threads of earlier tests may still run beside it."""

import tracemalloc

TRIES = 3  # what another thread takes is chance, what the call takes comes again


def peak_memory(call):
    """The most bytes that call() holds at once by itself: the least of TRIES calls.

    Python counts the allocations of all threads together."""
    return min(_peak_beside_others(call) for _ in range(TRIES))


def _peak_beside_others(call):
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
