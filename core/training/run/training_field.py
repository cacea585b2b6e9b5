"""A field in training, on a fixed mesh: tables, networks, surroundings, occupancy.

`march` and `composite` render rays with gradients; `update_occupancy` and `hide_unseen`
set the sub-tets that may have density (see field/occupancy.py).

Shapes: R rays, N packed samples, T tets with 64 sub-tets each.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import islice
from typing import NamedTuple

import numpy as np
import torch
import warp as wp

from ...definition.loss import MOST_LOGIT, SMALLEST_OPACITY
from ...field import (
    FEATURES,
    GEOMETRY_FEATURES,
    SUBTET_COUNT,
    FieldOptions,
    TetField,
    TorchNetworks,
    make_tables,
    random_field,
    subtet_corners,
    subtet_middles,
    subtet_of,
)
from ...geometry import TetMesh, tet_neighbours
from ...render import Pose
from .batch import Batch
from .checkpoint import CheckpointError
from .differentiable import Composite, Encode
from .distributed import ALONE, Workers
from .memory import within_memory

OCCUPIED_THICKNESS = 1e-2  # σ·Δ from which a sub-tet is occupied, however many others are
EMPTY_THICKNESS = 1e-4  # below it is empty, even where everything is as thin
OCCUPANCY_DECAY = 0.95  # of the thickness per update: space that got empty stays some 60 updates
UPDATE_CHUNK, SMALLEST_CHUNK = 1 << 20, 1 << 10  # sub-tets evaluated at once
LOOK_RAYS, SMALLEST_LOOK = 1 << 14, 1 << 6  # rays traced at once to find what none of them sees
INITIAL_CONTRAST = 1e-4  # of the features: the field starts smooth

wp.set_module_options({"enable_backward": False})


@wp.kernel
def mark_seen_kernel(
    sample_tet: wp.array(dtype=int),  # [N]
    sample_bary: wp.array(dtype=wp.vec4),  # [N]
    weights: wp.array(dtype=float),  # [N]
    seen: wp.array(dtype=float),  # [T · 64] in, out: largest weight so far
):
    n = wp.tid()
    wp.atomic_max(
        seen, sample_tet[n] * wp.static(SUBTET_COUNT) + subtet_of(sample_bary[n]), weights[n]
    )


@wp.kernel
def weigh_matter_kernel(
    counts: wp.array(dtype=int),  # [R]
    ends: wp.array(dtype=int),  # [R] inclusive scan of counts
    rgba: wp.array(dtype=wp.vec4),  # [R] what the pixels show
    sample_tet: wp.array(dtype=int),  # [N]
    weights: wp.array(dtype=float),  # [N]
    matter: wp.array(dtype=float),  # [T] in, out: sum of the weights
    refuted: wp.array(dtype=float),  # [T] in, out: of those that the pixel's alpha is too low for
):
    i = wp.tid()
    n = ends[i] - counts[i]
    while n < ends[i]:
        wp.atomic_add(matter, sample_tet[n], weights[n])
        if rgba[i][3] < 0.5 * weights[n]:
            wp.atomic_add(refuted, sample_tet[n], weights[n])
        n += 1


class RenderedRays(NamedTuple):
    """A batch of rays and samples, rendered with gradients, as torch tensors."""

    color: torch.Tensor  # [R, 3] without background
    opacity: torch.Tensor  # [R]
    distortion: torch.Tensor  # [R]
    lead: torch.Tensor  # [R], see definition/loss.py
    weights: torch.Tensor  # [N]
    visible: torch.Tensor  # [R] int: number of visible samples, see compositing.py
    excess: torch.Tensor  # [R], see loss.py


class TrainingField:
    """The weights and the occupancy that training changes.

    Args:
        surroundings: LearnedSurroundings that learn beside it, or None.
        exposure: LearnedExposure of the photographs, or None.
        plates: LearnedPlates behind the object, or None.
        subtet_mask: If false, a tet is occupied as a whole as soon as one sub-tet is.
        box: Sub-tets whose middle lies outside of it never hold anything; None: no such box.
            [2, 3]
    """

    def __init__(
        self,
        mesh: TetMesh,
        options: FieldOptions,
        device,
        seed=0,
        surroundings=None,
        subtet_mask=True,
        workers: Workers = ALONE,
        box=None,
        exposure=None,
        plates=None,
    ):
        self.device = wp.get_device(device)
        self.torch_device = torch.device(wp.device_to_torch(self.device))
        self.options = options
        self.surroundings, self.exposure, self.plates = surroundings, exposure, plates
        self.subtet_mask = subtet_mask
        self.workers = workers
        neighbours = tet_neighbours(mesh.tets)
        self._start = random_field(mesh, neighbours, options, seed, INITIAL_CONTRAST)
        self.layout = self._start.layout
        self.tables = make_tables(mesh, self.layout, self.device)
        self.pose = Pose(mesh, neighbours, self.device)
        table = torch.from_numpy(self._start.table)
        rows = self.workers.padded(len(table))
        self.rows = torch.zeros(rows, FEATURES, device=self.torch_device)
        self.rows[: len(table)] = table
        self.table = torch.nn.Parameter(self.rows[: len(table)])  # the same memory
        # Several workers exchange what the encoder reads on CUDA, see exchange.py.
        exchanges_half = workers.count > 1 and self.device.is_cuda
        self.half_rows = self.rows.half() if exchanges_half else None
        networks = TorchNetworks(self._start.density_layers, self._start.color_layers)
        self.networks = networks.to(self.torch_device)
        shape = (mesh.tet_count, SUBTET_COUNT)
        self.thickness = torch.zeros(shape, device=self.torch_device)
        self.occupied = torch.ones(shape, dtype=torch.bool, device=self.torch_device)
        self.hidden = torch.zeros(shape, dtype=torch.bool, device=self.torch_device)
        self._outside = None
        if box is not None:
            middles = subtet_middles(mesh)
            is_outside = ((middles < box[0]) | (middles > box[1])).any(axis=2)
            self._outside = torch.from_numpy(is_outside).to(self.torch_device)
            self.hidden |= self._outside
            self.occupied &= ~self.hidden
        self._mask_bits = torch.zeros(shape[0], dtype=torch.int64, device=self.torch_device)
        self.mask = wp.from_torch(self._mask_bits, dtype=wp.uint64)
        self.refresh_mask()
        self._turn = 0  # which of the sub-tets are measured next
        self._chunk = UPDATE_CHUNK
        self._generator = torch.Generator(device=self.torch_device).manual_seed(seed)
        corners = torch.from_numpy(subtet_corners().astype(np.float32))
        self._corners = corners.to(self.torch_device)  # [64, corner, 4]

    @property
    def mesh(self) -> TetMesh:
        return self._start.mesh

    def march(self, batch: Batch):
        """Find the samples of the batch's rays in what is occupied."""
        options = self.options
        mask = self.mask if batch.mask is None else batch.mask
        batch.march(self.pose, mask, options.march_step, options.view_dependence)

    def composite(self, batch: Batch) -> RenderedRays:
        """Render marched rays with gradients."""
        samples = batch.samples
        sigma, values = self.evaluate(batch, self.encode(samples.tet, samples.bary))
        along = samples.length, samples.t, batch.counts, batch.ends
        sums, opacity, *others = Composite.apply(sigma, values, *along)
        color, excess = self.color(batch, sums, opacity)
        return RenderedRays(color, opacity, *others, excess)

    def evaluate(self, batch: Batch, features):
        """sigma [N], and what a ray sums of the samples: colors [N, 3], or h [N, 16]."""
        sample_count = wp.to_torch(batch.sample_count)
        with self.precision():
            if self.options.deferred:
                return self.networks.geometry(features, sample_count)
            return self.networks.evaluate(features, batch.basis, sample_count)

    def color(self, batch: Batch, sums, opacity):
        """The colors [R, 3] of rays, times their opacity, from what they summed; their excess [R].

        Colors of samples have no excess.
        """
        if not self.options.deferred:
            return sums, torch.zeros_like(opacity)
        means = sums / opacity.clamp(min=SMALLEST_OPACITY)[:, None]
        with self.precision():  # at rest a ray has one direction
            logits = self.networks.logits(means, batch.ray_basis(self.options.view_dependence))
        beyond = (logits.abs() - MOST_LOGIT).clamp(min=0.0)
        # Detached: nothing becomes transparent because its color costs something.
        excess = opacity.detach() * beyond.square().sum(dim=1)
        return opacity[:, None] * torch.sigmoid(logits), excess

    def entries(self):
        """The table's values that this worker has whole: float32, or exchanged as float16."""
        if self.half_rows is None:
            return self.table.detach()
        return self.half_rows[: len(self.table)]

    def encode(self, sample_tet, sample_bary):
        """Features of samples, differentiable in the table.  [N, L·F]"""
        entries = self.entries()
        if self.device.is_cuda:
            entries = entries.half()  # halves what the gathers move
        return Encode.apply(
            self.table, entries, self.tables, self.layout.level_count, sample_tet, sample_bary
        )

    @torch.no_grad()
    def update_occupancy(self, turns=1):
        """Measure the thickness of one sub-tet in `turns`, in turn; then renew the mask."""
        every = slice(self._turn % turns, None, turns)
        self._turn += 1
        flat = self.thickness.view(-1)
        cells = torch.arange(len(flat), device=self.torch_device)[every]

        def measure(size):
            self._chunk = size
            return torch.cat([self._thickness_of(some) for some in cells.split(size)])

        found = within_memory(
            measure, self._chunk, SMALLEST_CHUNK, "sub-tets at once", self.workers, self.device
        )
        self.thickness *= OCCUPANCY_DECAY ** (1.0 / turns)
        # Weights that became infinite are given up soon after, and so is their occupancy.
        flat[every] = torch.maximum(flat[every], found.nan_to_num(0.0, 0.0))
        threshold = self.thickness.mean().clamp(EMPTY_THICKNESS, OCCUPIED_THICKNESS)
        self._occupy((self.thickness > threshold) & ~self.hidden)

    @torch.no_grad()
    def densities(self):
        """The density at a random point of each sub-tet, whether it is occupied or not.  [T, 64]"""
        cells = torch.arange(self.thickness.numel(), device=self.torch_device)
        found = torch.cat([self._thickness_of(some) for some in cells.split(self._chunk)])
        return found.view_as(self.thickness) / self.options.march_step

    def _thickness_of(self, cells):
        """σ·Δ at a random point of each sub-tet.  [n] int64 -> [n]"""
        beta = torch.empty(len(cells), 4, device=self.torch_device)
        beta = beta.exponential_(generator=self._generator)
        beta /= beta.sum(dim=1, keepdim=True)
        bary = torch.einsum("nj,njk->nk", beta, self._corners[cells % SUBTET_COUNT])
        tet = (cells // SUBTET_COUNT).int()
        share = self.workers.share(len(cells))  # all draw the same, each evaluates its share
        mine = slice(share.start, share.stop)
        features = self.encode(
            wp.from_torch(tet[mine].contiguous()),
            wp.from_torch(bary[mine].contiguous(), dtype=wp.vec4),
        )
        with self.precision():
            h = self.networks.density_features(features)
        sigma = self.networks.sigma(h)
        return self.workers.gather(sigma, len(cells)) * self.options.march_step

    @torch.no_grad()
    def hide_unseen(
        self,
        looks: Callable[[int], Iterable[Batch]],
        smallest_weight: float,
        with_refuted: bool = False,
    ):
        """Mask sub-tets in which no ray has a sample of at least that weight.

        What no camera ever saw, above all the inside of what is opaque, stays hidden in
        every pose, because optical depth is measured in rest space.

        Args:
            looks: Given a number of rays, batches of at most as many; see batch.looks.
            with_refuted: Mask whole tets, too, if images with alpha refute their matter.  A pixel
                refutes a sample whose weight is more than twice the pixel's alpha.  A tet goes if
                refuted samples have more than half of the weight of its samples, as fog does that
                cameras see beside the object.
        """

        def weigh(ray_count):
            seen = torch.zeros(self.thickness.numel(), device=self.torch_device)
            matter, refuted = torch.zeros(2, len(self.thickness), device=self.torch_device)
            batches = enumerate(looks(ray_count), start=1)
            for seed, batch in islice(batches, self.workers.rank, None, self.workers.count):
                batch.seed.fill_(seed)
                self.march(batch)
                samples, weights = batch.samples, wp.from_torch(self.composite(batch).weights)
                places = [samples.tet, samples.bary, weights]
                self._launch(mark_seen_kernel, len(weights), places, [seen])
                if with_refuted:
                    rays = [batch.counts, batch.ends, batch.drawn.rgba, samples.tet, weights]
                    self._launch(weigh_matter_kernel, batch.ray_count, rays, [matter, refuted])
            return seen, matter, refuted

        seen, matter, refuted = within_memory(
            weigh, LOOK_RAYS, SMALLEST_LOOK, "rays at once", self.workers, self.device
        )
        self.workers.max_(seen)
        self.hidden = (seen < smallest_weight).view_as(self.hidden)
        if with_refuted:
            for sums in matter, refuted:
                self.workers.sum_(sums)
            self.hidden |= (refuted > 0.5 * matter)[:, None]
        if self._outside is not None:
            self.hidden |= self._outside
        self._occupy(self.occupied & ~self.hidden)

    def _launch(self, kernel, dim, inputs, outputs):
        """Launch a kernel whose outputs are torch tensors."""
        outputs = [wp.from_torch(each) for each in outputs]
        wp.launch(kernel, dim=dim, inputs=inputs, outputs=outputs, device=self.device)

    def _occupy(self, subtets):
        """Make these the occupied sub-tets.  [T, 64] bool"""
        if not self.subtet_mask:
            subtets = subtets | subtets.any(dim=1, keepdim=True)
        self.workers.broadcast_(subtets)
        self.occupied = subtets
        self.refresh_mask()

    def parameters(self) -> list:
        """The trained parameters: those of the table, the networks, and what learns beside them."""
        beside = [m for m in (self.surroundings, self.exposure, self.plates) if m is not None]
        return [
            self.table,
            *self.networks.parameters(),
            *(p for m in beside for p in m.parameters()),
        ]

    @torch.no_grad()
    def set_weights(self, weights):
        """Copy these into the parameters; None leaves them as they are."""
        for mine, given in zip(self.parameters(), weights or (), strict=weights is not None):
            mine.copy_(given)
        if self.half_rows is not None:
            self.half_rows.copy_(self.rows)

    @torch.no_grad()
    def set_occupancy(self, thickness, occupied):
        """Take the thickness and the occupancy of before.  [T, 64] each"""
        self.thickness.copy_(thickness)
        self.occupied.copy_(occupied)
        self.refresh_mask()

    def state(self) -> dict:
        """Everything that learning changes, as tensors."""
        return {
            "parameters": [p.detach() for p in self.parameters()],
            "thickness": self.thickness,
            "occupied": self.occupied,
            "hidden": self.hidden,
            "part": self._turn,
            "generator": self._generator.get_state(),
            "plates": self._places(),
        }

    @torch.no_grad()
    def load_state(self, state: dict):
        """Go on from the state of a field with this mesh and options.

        Raises:
            CheckpointError: The masks were others, and so what is learned behind the object.
        """
        if state.get("plates", self._places()) != self._places():
            raise CheckpointError(
                "the masks have changed since the run was interrupted: put back those that were "
                "there, or train without --resume"
            )
        self.set_weights(state["parameters"])
        self.hidden.copy_(state["hidden"])
        self.set_occupancy(state["thickness"], state["occupied"])
        self._turn = state["part"]
        self._generator.set_state(state["generator"].cpu())

    def _places(self) -> int:
        """A number that says which pixels the plates are behind; 0 without plates."""
        return 0 if self.plates is None else self.plates.fingerprint()

    def export(self, world_to_model, meta) -> TetField:
        """A copy of the field as it stands."""
        density, color = self.networks.layers()
        if not self.options.view_dependence:
            color[0][0][GEOMETRY_FEATURES + 1 :] = 0.0  # nothing has trained them
        return replace(
            self._start,
            occupancy=self.mask.numpy().copy(),  # on the CPU it shares memory with the mask
            table=self.table.detach().cpu().numpy().copy(),
            density_layers=density,
            color_layers=color,
            world_to_model=world_to_model,
            meta=meta,
            surroundings=self.surroundings and self.surroundings.export(),
        )

    def precision(self):
        """fp16 layers on CUDA; the encoding and the sums stay in float32."""
        return torch.autocast(
            self.torch_device.type,
            torch.float16,
            enabled=self.device.is_cuda,
            cache_enabled=False,  # a CUDA graph has to see the weights' conversion
        )

    def refresh_mask(self):
        bits = torch.arange(SUBTET_COUNT, device=self.torch_device)
        # Wraps to the same 64 bits; in place, because a CUDA graph knows the address.
        self._mask_bits.copy_((self.occupied.long() << bits).sum(dim=1))
