"""Programs that write a model: saving, deformrf edit, deformrf rig import and bind."""

import numpy as np
from fuzzing.models import small_models
from point_caches import write_cache

from deformrf.core.base.paths import DEFAULT_MODEL
from deformrf.core.field import load, save
from deformrf.wings import rig as rigs

from .kinds import Fault, OneFile, Signals
from .process import Job


def save_model(source, path):
    save(load(source), path)


class WrittenModel(OneFile):
    """A model file, which is the same as that of a run that nobody cut off."""

    def prepare(self):
        self.first, self.second = small_models(self.inputs)
        self.vertices = load(self.second).mesh.rest_vertices.astype(np.float32)

    def learn(self):
        self.expected = self.path.read_bytes()

    def old(self):
        return self.first.read_bytes()

    def is_whole(self):
        load(self.path)
        if self.path.read_bytes() != self.expected:
            raise Fault("its bytes are not those of a run that was not cut off")


class Save(WrittenModel):
    """The bundled model is written, which takes as long as others."""

    def job(self):
        return Job((DEFAULT_MODEL, self.path), save_model)


class Edit(WrittenModel):
    """`deformrf edit` of the bundled model; half of the times over its own model."""

    def old(self):
        return DEFAULT_MODEL.read_bytes()

    def job(self):
        model = DEFAULT_MODEL if self.before is None else self.path
        return Job(("edit", model, "-o", self.path, "--specks", 0.5))


class Import(WrittenModel):
    """`deformrf rig import` of a point cache to a model with a rig, or over that model."""

    def prepare(self):
        super().prepare()
        frames = np.repeat(self.vertices[None], 200, axis=0)
        self.clip = self.inputs / "wave.pc2"
        write_cache(rigs.VertexClip("wave", np.arange(200) / 24.0, frames), self.clip)

    def old(self):
        return self.second.read_bytes()

    def job(self):
        model = self.second if self.before is None else self.path
        return Job(("rig", "import", model, self.clip, "-o", self.path))


class Bind(WrittenModel):
    """`deformrf rig bind` of a rig file to a model without one, or over that model."""

    def prepare(self):
        super().prepare()
        self.rig = self.inputs / "rig.npz"
        np.savez(self.rig, **rigs.arrays_of(rigs.load_rig(self.second, len(self.vertices))))

    def job(self):
        model = self.first if self.before is None else self.path
        return Job(("rig", "bind", model, self.rig, "-o", self.path))


class EditSignals(Signals, Edit):
    pass


class ImportSignals(Signals, Import):
    pass
