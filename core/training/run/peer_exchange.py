"""Exchange between GPUs of one host that read and write each other's memory.

Collectives send gradients, wait, update, send weights, and wait again.  Here one kernel does all
of this for a worker's share of the table: it reads the gradients from the memory of all workers,
makes Adam's update (Kingma and Ba 2015), and writes the new values into the tables of all
workers.  So transfers between GPUs overlap with accesses to each GPU's own memory.

    barrier          all workers have written their gradients, and none reads the table any more
    update           each worker updates its share of the table, and all other weights
    barrier          all workers have written their shares

A worker rounds its gradient to bfloat16 once, and the sums are float32.
"""

import os
from contextlib import suppress

import torch
import torch.distributed as dist
import warp as wp

from ...base.wide import load_wide, load_wide_bfloat, store_wide, store_wide_half, vec4b, vec4h
from .adam import BETAS, EPSILON
from .distributed import Workers
from .exchange import Exchange
from .memory import lacks_memory
from .training_field import TrainingField

# What another PyTorch raises, or GPUs that cannot share memory.
NO_PEERS = (ImportError, AttributeError, TypeError, RuntimeError)

wp.set_module_options({"enable_backward": False})


@wp.kernel
def add_up_kernel(
    theirs: wp.array(dtype=wp.uint64),  # [workers] addresses of float32 [n]
    sums: wp.array(dtype=float),  # [n] out: means over all pixels tried, last their number
    step: wp.array(dtype=float),  # [1] in, out: counts the updates
):
    """Add up what is not the table's: gradients, error, and number of pixels, which divides."""
    i = wp.tid()
    n = sums.shape[0]
    total, weight = float(0.0), float(0.0)
    worker = int(0)
    while worker < theirs.shape[0]:  # in the same order on all workers
        values = wp.array(ptr=theirs[worker], shape=(n,), dtype=float)
        total += values[i]
        weight += values[n - 1]
        worker += 1
    weight = wp.max(weight, 1.0)
    sums[i] = wp.where(i == n - 1, weight, total / weight)
    if i == 0:
        step[0] = step[0] + 1.0


@wp.kernel
def update_table_kernel(
    gradients: wp.array(dtype=wp.uint64),  # [workers] addresses of bfloat16 [rows, 4]
    weight: wp.array(dtype=float),  # [1] number of pixels, which divides their sum
    first: int,  # this worker's first row
    rate: wp.array(dtype=float),  # [1]
    step: wp.array(dtype=float),  # [1] number of this update, from 1
    beta1: float,
    beta2: float,
    epsilon: float,
    mean: wp.array(dtype=wp.vec4),  # [part] in, out: of the gradient
    square: wp.array(dtype=wp.vec4),  # [part] in, out: of its square
    part: wp.array(dtype=wp.vec4),  # [part] in, out: this worker's rows
    rows: int,
    tables: wp.array(dtype=wp.uint64),  # [workers] addresses of float16 [rows, 4], out
):
    """Update this worker's rows by Adam, and write them into the tables of all workers."""
    i = wp.tid()
    g = wp.vec4()
    worker = int(0)
    while worker < gradients.shape[0]:
        theirs = wp.array(ptr=gradients[worker], shape=(rows,), dtype=vec4b)
        g += load_wide_bfloat(theirs, first + i)
        worker += 1
    g /= weight[0]
    m = load_wide(mean, i)
    m += (1.0 - beta1) * (g - m)
    v = beta2 * load_wide(square, i) + (1.0 - beta2) * wp.cw_mul(g, g)
    size = rate[0] / (1.0 - wp.pow(beta1, step[0]))
    scale = 1.0 / wp.sqrt(1.0 - wp.pow(beta2, step[0]))
    w = load_wide(part, i)
    for k in range(4):
        w[k] = w[k] - size * m[k] / (wp.sqrt(v[k]) * scale + epsilon)
    store_wide(mean, i, m)
    store_wide(square, i, v)
    store_wide(part, i, w)
    reader = int(0)
    while reader < tables.shape[0]:
        table = wp.array(ptr=tables[reader], shape=(rows,), dtype=vec4h)
        store_wide_half(table, first + i, w)
        reader += 1


class PeerMemory:
    """Memory of the GPUs of one host that all of them can use.

    Raises:
        ImportError, AttributeError, TypeError: This PyTorch has no such memory.
        RuntimeError: A GPU cannot use another one's.
    """

    def __init__(self, workers: Workers, device):
        # Not a public interface of PyTorch yet.
        import torch.distributed._symmetric_memory as symmetric_memory

        self._empty, self._meet = symmetric_memory.empty, symmetric_memory.rendezvous
        self.workers, self.device, self._barrier = workers, device, None
        of_one_host = os.environ.get("LOCAL_WORLD_SIZE") == os.environ.get("WORLD_SIZE")
        if not of_one_host or torch.cuda.device_count() < workers.count:
            raise RuntimeError("not all workers' GPUs are of one host and visible to all workers")
        others = set(range(workers.count)) - {device.index}
        if not all(torch.cuda.can_device_access_peer(device.index, other) for other in others):
            raise RuntimeError("the GPUs have no access to each other's memory")
        os.environ.setdefault("TORCH_SYMM_MEM_DISABLE_MULTICAST", "1")  # it is not used

    def share(self, like) -> list:
        """Each worker's tensor of that shape and type; this one's has the values of `like`."""
        mine = self._empty(like.shape, dtype=like.dtype, device=self.device).copy_(like)
        shared = self._meet(mine, dist.group.WORLD)
        self._barrier = shared.barrier
        tensors = [shared.get_buffer(i, like.shape, like.dtype) for i in range(self.workers.count)]
        tensors[self.workers.rank] = mine
        return tensors

    def barrier(self):
        """Make the current stream wait for the other workers' streams."""
        self._barrier()


class PeerExchange(Exchange):
    """The exchange through memory that all workers use.

    Args:
        memory: The PeerMemory, or what has its methods.
    """

    def __init__(self, field: TrainingField, error, memory):
        super().__init__(field, error)
        self._memory, rank = memory, field.workers.rank
        self._tables, self._gradients, self._sums_of_all = (
            memory.share(mine) for mine in (field.half_rows, self._table_gradient, self._mine)
        )
        field.half_rows = self._tables[rank]
        self._table_gradient = self._gradients[rank]
        self._mine = self._sums_of_all[rank]
        self._addresses = [
            wp.array([t.data_ptr() for t in tensors], dtype=wp.uint64, device=field.device)
            for tensors in (self._gradients, self._tables, self._sums_of_all)
        ]

    def tasks(self, optimizer) -> dict:
        return {"exchange": (lambda: self._exchange(optimizer), True)}

    def _exchange(self, optimizer):
        self._memory.barrier()
        self.update(optimizer)
        self._memory.barrier()

    @torch.no_grad()
    def update(self, optimizer):
        state = optimizer.state_of(self._share)
        gradients, tables, sums_of_all = self._addresses
        step = wp.from_torch(state["step"].view(1))
        wp.launch(
            add_up_kernel,
            dim=len(self._sums),
            inputs=[sums_of_all],
            outputs=[wp.from_torch(self._sums), step],
            device=self.field.device,
        )

        def update_others():
            self._hand_out()
            optimizer.step()  # the share of the table has no gradient

        def update_table():
            group = optimizer.param_groups[0]
            rate = torch.as_tensor(group["lr"], device=self.error.device).view(1)
            vectors = (state["exp_avg"], state["exp_avg_sq"], self._share.detach())
            wp.launch(
                update_table_kernel,
                dim=len(self._share),
                inputs=[
                    gradients,
                    wp.from_torch(self._sums[-1:]),
                    self.workers.rank * len(self._share),
                    wp.from_torch(rate),
                    step,
                    *BETAS,
                    EPSILON,
                    *(wp.from_torch(vector, dtype=wp.vec4) for vector in vectors),
                    len(self.field.rows),
                    tables,
                ],
                device=self.field.device,
            )

        self.side_by_side(update_others, update_table)


def make_exchange(field: TrainingField, error) -> Exchange:
    """The quickest exchange that the workers' GPUs allow, the same for all workers."""
    workers, memory, exchange = field.workers, None, None
    if field.device.is_cuda:
        with suppress(*NO_PEERS):
            memory = PeerMemory(workers, error.device)
    if workers.any(memory is None):  # before the workers wait for each other's memory
        return Exchange(field, error)
    try:
        exchange = PeerExchange(field, error, memory)
    except NO_PEERS as failure:
        if lacks_memory(failure):
            raise
    return Exchange(field, error) if workers.any(exchange is None) else exchange
