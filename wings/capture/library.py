"""The library pycolmap, loaded in this one place, and calls of it that Ctrl-C can end."""

import signal
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait

import numpy  # noqa: F401
from PIL import Image  # noqa: F401

POLL_SECONDS = 0.2  # how often Python looks for Ctrl-C during a call
SEED = 0  # of all random numbers, so that the same photographs have the same cameras


def load_pycolmap():
    """The module pycolmap: silent, and without handlers of signals.

    NumPy and Pillow have to be loaded before it: Pillow's PNG encoder, loaded after pycolmap,
    destroys the heap (pycolmap 4.2.1, Pillow 13.0).

    Raises:
        ModuleNotFoundError: It is not installed.
    """
    if sys.modules.get("pycolmap"):
        return sys.modules["pycolmap"]
    handlers = {}
    if is_main := threading.current_thread() is threading.main_thread():
        numbers = (signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGHUP", None))
        handlers = {n: signal.getsignal(n) for n in numbers if n is not None}
    import pycolmap

    # Its log library would end the process at SIGTERM, where ours saves what is done.
    for number, handler in handlers.items() if is_main else ():
        if handler is not None:
            signal.signal(number, handler)
    pycolmap.logging.minloglevel = pycolmap.logging.FATAL.value
    pycolmap.set_random_seed(SEED)
    return pycolmap


class Threads(ThreadPoolExecutor):
    """Threads that end soon after Ctrl-C: calls that have not begun by the end are given up."""

    def __exit__(self, *error):
        self.shutdown(cancel_futures=True)


def interruptible(call: Callable, *arguments, each: Callable = lambda: None, **named):
    """Call a function of pycolmap in a thread, so that Ctrl-C is heard meanwhile.

    Args:
        call: It looks at its argument `cancellation_token`, which Ctrl-C cancels.
        each: Called every POLL_SECONDS, in this thread.
    """
    token = load_pycolmap().CancellationToken()
    pool = ThreadPoolExecutor(1)
    future: Future = pool.submit(call, *arguments, cancellation_token=token, **named)
    try:
        while not wait([future], POLL_SECONDS).done:
            each()
        return future.result()
    except KeyboardInterrupt:
        token.cancel()
        wait([future])
        raise
    finally:
        pool.shutdown(wait=future.done(), cancel_futures=True)
