"""Omissions in rendering at rest, and in the model file whose field is rendered.

A turn renders one view with what is left out and once without; the next turn takes the next
view.  Each side has its own renderer: on CUDA a renderer predicts the number of rounds from
its last images.  Images are compared over all views, over white.
"""

import io
from dataclasses import replace
from functools import cache, partial
from itertools import cycle
from types import SimpleNamespace

import numpy as np

from ....core.field import TetField, modelfile, multiplies_pairs, occupied_share, reached_entries
from ....core.field.packing import pack_tables, wide_levels
from ....core.render import Renderer, RenderOptions, default_stop, visible_field
from ..effort import Effort
from ..rendering.pictures import views
from ..stopwatch import compared, in_turns
from .switch import FILE, RENDERING, Switch, image_change

FULL = np.uint64(2**64 - 1)  # a tet's mask without an empty sub-tet


class ViewSeries:
    """Renders a field at rest from one camera after another."""

    def __init__(self, field: TetField, device, cameras, **options):
        self.renderer = Renderer(field, device)
        self.renderer.set_vertices(field.mesh.rest_vertices)
        self._cameras, self._following = cameras, cycle(cameras)
        self._options = RenderOptions(**options)

    def turn(self):
        """Render the next view."""
        self.renderer.render(next(self._following), self._options)

    def images(self) -> list:
        """All views: [H, W, 4] uint8 each."""
        return [self.renderer.render(c, self._options).color_array() for c in self._cameras]


def frame_switches(field: TetField, device, effort: Effort) -> list[Switch]:
    """The switches of an image, and of the field's file."""
    cameras = views(field, effort.view_count, effort.frame_size)

    def series(other=field, **options):
        return ViewSeries(other, device, cameras, **options)

    usual = cache(series)

    def switch(name, with_it, without, why):
        def measure():
            one, other = with_it(), without()
            times = compared(one.turn, other.turn, device, effort.frame_turns)
            return times, image_change(one.images(), other.images())

        return Switch(name, RENDERING, "ms", why, measure)

    spent = 100.0 - 100.0 * default_stop(field.options.deferred)
    found = [
        *_density_switches(field, series, usual, switch),
        switch(
            "samples behind what is opaque",
            lambda: series(termination=0.0),
            usual,
            f"A ray ends once {spent:g} % of it is spent; what is behind is taken"
            " to look like what is before. The test is one comparison a sample.",
        ),
        switch(
            "the path for overlap, at rest",
            lambda: series(path="merge"),
            usual,
            "Nothing overlaps at rest, which is tested once a pose, so no ray has to sort media"
            " or store its pieces.",
        ),
        switch(
            "rendering again what did not change",
            usual,
            lambda: SimpleNamespace(turn=lambda: None, images=usual().images),
            "Neither camera nor vertices changed, so the same image would come out.",
        ),
    ]
    if not field.options.view_dependence:
        dependent = replace(field, options=replace(field.options, view_dependence=True))
        why = "The model was trained without it, and its colors depend on no direction."
        found.append(switch("view dependence", lambda: series(dependent), usual, why))
    return [*found, *_round_switches(device, series, usual, switch), _entries(field, series)]


def _density_switches(field, series, usual, switch):
    """The switches of what has no density."""

    def every_tet():
        every = series(replace(field, occupancy=np.full_like(field.occupancy, FULL)))
        every.renderer.set_occupancy(field.occupancy)
        return every

    filled = np.where(field.occupancy == 0, field.occupancy, FULL)
    empty_tets = 100.0 * (field.occupancy == 0).mean()
    empty = 100.0 * (1.0 - occupied_share(visible_field(field)[0].occupancy))
    return [
        switch(
            "samples in empty sub-tets",
            lambda: series(replace(field, occupancy=filled)),
            usual,
            f"{empty:.0f} % of the sub-tets of the tets that rays cross are empty. The density"
            " there was never trained: it would be seen, and it would end rays early.",
        ),
        switch(
            "tets without density on a ray's way",
            every_tet,
            usual,
            f"{empty_tets:.0f} % of the tets serve the dynamics alone; they are removed once, when"
            " a model is loaded.",
        ),
    ]


def _round_switches(device, series, usual, switch):
    """The switches of how a device evaluates a round of samples."""
    on_cpu, found = device == "cpu", []
    # float32 always runs in rounds that the host waits for, so half precision does here, too.
    host = cache(lambda: series(path="host"))
    if not on_cpu:
        why = "The device knows how many rays go on; an image is one CUDA graph."
        found.append(switch("rounds that the host waits for", host, usual, why))
    if not on_cpu or multiplies_pairs():
        why = (
            "A processor with bfloat16 multiplies a pair in the time of one float32; on CUDA,"
            " float16 uses tensor cores and needs no torch."
        )
        single = partial(series, single_precision=True)
        found.append(switch("single precision of networks", single, host, why))
    return found


def _entries(field, series):
    """Table entries that no occupied sub-tet reaches, in 10⁶ bytes of a written file."""
    reached = reached_entries(field.mesh, field.layout, field.occupancy)

    def measure():
        arrays = modelfile.pack(field)
        kept = {name: a for name, a in arrays.items() if not name.startswith("reached_")}
        bits = field.entry_bits or 16
        wide = wide_levels(field.layout, reached)
        every = kept | pack_tables(field.table, field.layout, np.ones_like(reached), bits, wide)
        # The file does not contain these entries, so noise stands for their values.  Both tables
        # are in floats: noise has more digits than bytes hold.
        noise = np.random.default_rng(0).normal(size=field.table.shape) * field.table.std()
        tables = (np.where(reached[:, None], field.table, rest) for rest in (noise, 0.0))
        tables = [table.astype(np.float32) for table in tables]
        noisy, zero = (series(replace(field, table=t, entry_bits=None)) for t in tables)
        sizes = in_turns([_megabytes(every)], [_megabytes(arrays)])
        return sizes, image_change(noisy.images(), zero.images())

    why = (
        f"{100.0 * (1.0 - reached.mean()):.0f} % of the entries are read by nothing that has"
        " density. A level for which saying so would take more bytes than it saves is stored whole."
    )
    return Switch("table entries that no occupied sub-tet reaches", FILE, "MB", why, measure)


def _megabytes(arrays) -> float:
    """Size of a file with these arrays [10⁶ bytes]."""
    stream = io.BytesIO()
    modelfile.write(arrays, stream)
    return stream.tell() / 1e6
