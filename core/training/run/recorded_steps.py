"""Training steps on CUDA, recorded as graphs, with the next batches marched ahead.

A march is a long chain of small loads that leaves the GPU nearly idle.  So while the field is
trained on one batch, the next ones are marched at the same time, each on a stream of its own.  A
batch is marched with a copy of the occupancy mask, which is made AHEAD steps before the field is
trained on the batch.  Updates of the mask in these steps do not reach the batch.

Within a recorded step nothing waits for the host: it has a fixed number of rays and fixed arrays
for samples; learning rate, background and seed are values on the device.
"""

from collections.abc import Callable

import torch
import warp as wp

from ...base.memory import no_garbage_collected
from .batch import Batch

AHEAD = 4  # batches that are being marched while one is learned from


class RecordedSteps:
    """Replays the steps of a ring of batches.

    Attributes:
        learn: For each batch, the tasks of the update from it: name -> function to call.

    Args:
        device: A CUDA Warp device, whose current stream is torch's too.
        batches: AHEAD + 1 of them; step n has batch n % (AHEAD + 1).
        march: Called with a batch, recorded.
        tasks: The tasks of the update, in order: name -> (function of a batch, whether to
            record it).
    """

    def __init__(
        self,
        device,
        batches: list[Batch],
        march: Callable[[Batch], None],
        tasks: dict[str, tuple[Callable[[Batch], None], bool]],
    ):
        self._batches = batches
        self._main = wp.stream_to_torch(wp.get_stream(device))
        self._streams = [torch.cuda.Stream(self._main.device) for _ in batches[1:]]
        self._prepared = [torch.cuda.Event() for _ in self._streams]
        self._next = None  # the step whose batch was marched ahead
        self._march, self.learn, pool = [], [], None
        with no_garbage_collected():  # it would free device memory, which ends a recording
            for batch in batches:
                graph = recorded(device, march, batch)
                self._march.append(graph)
                learn = {}
                for name, (function, records) in tasks.items():
                    if records:
                        # Graphs of learning share one pool: no two of them run at the same time.
                        graph = recorded(device, function, batch, pool)
                        pool = graph.pool()
                        learn[name] = graph.replay
                    else:
                        learn[name] = lambda function=function, batch=batch: function(batch)
                self.learn.append(learn)

    def run(self, number: int, prepare: Callable[[Batch, int], None]):
        """Step `number`; one that doesn't follow the last step marches its batches anew.

        Args:
            prepare: Called with a batch and a step's number, before the batch is marched: copies
                what the march reads and later steps may change.
        """
        ahead = len(self._streams)
        if self._next != number:
            self.wait()
            for coming in range(number, number + ahead):
                self._march_ahead(coming, prepare)
        self._main.wait_stream(self._streams[number % ahead])
        self._march_ahead(number + ahead, prepare)
        for task in self.learn[number % len(self._batches)].values():
            task()
        self._next = number + 1

    def _march_ahead(self, number, prepare):
        way, place = number % len(self._streams), number % len(self._batches)
        stream = self._streams[way]
        stream.wait_stream(self._main)  # the batch's last step has to be over
        with torch.cuda.stream(stream):
            prepare(self._batches[place], number)
            self._prepared[way].record()
            self._march[place].replay()

    def wait(self):
        """Make the main stream wait for the marches that are under way."""
        for stream in self._streams:
            self._main.wait_stream(stream)

    def wait_until_prepared(self):
        """Make the main stream wait until all batches under way have copied what they read."""
        for event in self._prepared:
            self._main.wait_event(event)


def recorded(device, function: Callable[[Batch], None], batch: Batch, pool=None):
    """The torch.cuda.CUDAGraph of the torch and Warp launches of `function(batch)`.

    Args:
        pool: Memory of a graph that never runs at the same time, to be used again.
    """
    graph, stream = torch.cuda.CUDAGraph(), wp.get_stream(device)
    with torch.cuda.graph(
        graph,
        pool=pool,
        stream=wp.stream_to_torch(stream),
        capture_error_mode="thread_local",
    ):
        wp.capture_begin(device, stream=stream, external=True)
        try:
            function(batch)
        finally:
            wp.capture_end(device, stream=stream)
    return graph
