"""Model files: their bytes, `meta`, arrays; what is loaded is drawn in 8x8 pixels, and posed."""

import json
from dataclasses import replace

import numpy as np

from deformrf.core.field import FieldOptions, ModelFileError, load, random_field, save
from deformrf.core.geometry import a15_grid, extract, tet_neighbours
from deformrf.core.render import Renderer, from_field_of_view, look_at
from deformrf.wings import rig as rigs

from .damage import with_values
from .trees import Arrays, Tree, content_bytes
from .zips import with_zip

VIEW = from_field_of_view(look_at((1.6, 1.2, 0.9), (0.5, 0.5, 0.5)), 0.7, 8, 8)


def small_models(folder):
    """The paths of two models, of which the second has a rig."""
    for seed, (levels, bits) in enumerate([(3, 16), (1, 8)]):
        grid = a15_grid(0.25)
        mesh, _ = extract(grid, np.arange(grid.tet_count) < 60)
        options = FieldOptions(levels, 2**6, (16,), (16,), march_step=0.01)
        field = random_field(mesh, tet_neighbours(mesh.tets), options, seed)
        if seed:
            field = replace(field, rig_arrays=rigs.arrays_of(small_rig(mesh.vertex_count)))
        training = {"history": [{"seconds": 1.0, "stage": 1, "step": 16, "psnr": 20.0}]}
        save(field, folder / f"small{seed}.npz", training | {"test_mean": {"psnr": 3.0}}, bits)
        yield folder / f"small{seed}.npz"


def small_rig(vertex_count):
    """Two bones that share all vertices, with offsets and a clip of each kind."""
    skeleton = rigs.make_skeleton(["a", "b"], [-1, 0], np.eye(3)[:2], np.eye(3)[1:])
    weights, times = np.full((vertex_count, 2), 0.5, np.float32), np.arange(2) / 24.0
    offsets = np.ones((vertex_count, 2, 3), np.float32) * np.float32([[1], [-1]])
    turns = rigs.Channel(1, "rotation", "LINEAR", times, np.eye(4)[2:])
    frames = np.zeros((2, vertex_count, 3), np.float32)
    clips = rigs.Clip("turn", 1.0, (turns,)), rigs.VertexClip("stay", times, frames)
    return rigs.Rig(skeleton, weights, clips, offsets)


class Models(Tree):
    """Small models, one with a rig."""

    errors = (ModelFileError,)

    def __init__(self, folder):
        self.variants = []
        for path in small_models(folder):
            with np.load(path) as archive:
                self.variants.append({"a.npz": Arrays(archive)})

    def mutate(self, rng, folder):
        arrays = self.variants[rng.integers(len(self.variants))]["a.npz"]
        if rng.random() < 0.4:
            meta = with_values(rng, json.loads(arrays["meta"].tobytes()))
            meta = np.frombuffer(json.dumps(meta).encode(), np.uint8)
            data, what = content_bytes(Arrays(arrays | {"meta": meta})), "meta"
        else:
            data, what = with_zip(rng, content_bytes(arrays), arrays)
        (folder / "a.npz").write_bytes(data)
        return what

    def read(self, folder):
        field = load(folder / "a.npz")
        if field.rig_arrays is not None:
            _pose(field.rig_arrays, field.mesh.vertex_count)
        pixels = Renderer(field, "cpu").render(VIEW).color_array()
        assert np.isfinite(pixels).all(), "pixels are not finite"


def _pose(arrays, vertex_count):
    """Pose the bones of a rig, unless it is refused with one sentence."""
    try:
        rig = rigs.rig_from(arrays, vertex_count)
    except ValueError as error:
        raise ModelFileError(str(error)) from error  # the command says the same sentence
    for clip in rig.clips:
        bones = isinstance(clip, rigs.Clip)
        found = clip.matrices_at(rig.skeleton, 0.3) if bones else clip.vertices_at(0.3)
        assert np.isfinite(found).all(), clip
