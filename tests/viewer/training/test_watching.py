"""What is shown of a run: which snapshots get a scene, and the words; without a window."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from deformrf.core.field import modelfile
from deformrf.viewer.panels import training as panel
from deformrf.viewer.training import watching


@pytest.fixture
def watcher(tmp_path, monkeypatch):
    monkeypatch.setattr(watching, "choose_path", lambda *_: "copy")
    job = SimpleNamespace(device="cpu", output=tmp_path / "m.npz")
    made = watching.Watcher(SimpleNamespace(ctx=None))
    made.begin(job)
    return made


def made(watcher, field, path, step, kept=False):
    """The snapshot of a field, as if it was shown then."""
    modelfile.save(field, path)
    snapshot = watcher._made(path, step, kept)
    watcher._field = snapshot.field
    return snapshot


def test_a_new_mesh_comes_with_a_scene_and_the_same_mesh_without(watcher, field, ball, tmp_path):
    path = tmp_path / "s.npz"
    first = made(watcher, field, path, 16)
    assert first.scene is not None and not first.same_mesh and not path.exists()
    second = made(watcher, field, path, 30)
    assert second.scene is None and second.same_mesh and second.field.mesh is first.field.mesh
    third = made(watcher, ball, path, 48, kept=True)
    assert third.scene is not None and not third.same_mesh
    np.testing.assert_array_equal(third.field.mesh.tets, ball.mesh.tets)
    last = made(watcher, ball, watcher.job.output, math.inf)
    assert last.scene is not None and last.same_mesh and watcher.job.output.exists()


def test_scenes_are_made_anew_while_the_object_becomes_clear(watcher, field, tmp_path):
    """At twice the steps of the last one, until the user has touched it."""

    def at(step, kept=False):
        return made(watcher, field, tmp_path / "s.npz", step, kept).scene is not None

    assert [step for step in range(16, 272, 16) if at(step)] == [16, 32, 64, 128, 256]
    assert not at(512, kept=True)


def row(stage, step, psnr):
    return {"stage": stage, "step": step, "psnr": psnr, "seconds": 1.0}


def test_the_curve_goes_on_from_stage_to_stage():
    steps, psnr = panel.curve([row(1, 16, 9.0), row(1, 40, 12.0), row(2, 16, 15.0)])
    assert steps.tolist() == [16.0, 40.0, 56.0] and psnr.tolist() == [9.0, 12.0, 15.0]
    steps, _ = panel.curve([row(2, 16, 15.0)])  # without a coarse stage
    assert steps.tolist() == [16.0]


def test_the_panel_says_how_far_the_run_is():
    job = SimpleNamespace(progress=None, line="starting", steps_per_second=0.0)
    job.paused = job.stopping = job.trained = job.ended = False
    assert panel.training_lines(job) == ["starting"]
    job.progress = {"stage": 2, "step": 100, "steps": 600, "seconds": 187.0, "rate": 2.5e5}
    job.progress["history"] = [row(2, 96, 21.456)]
    job.steps_per_second = 5.0
    assert panel.training_lines(job) == [
        "stage 2 of 2, step 100 of 600",
        "21.46 dB on its training rays, 0.25 M samples/s",
        "3:07 so far, 1:40 left in this stage",
    ]
    job.paused = True
    assert panel.training_lines(job)[0].endswith(", waiting")
    job.ended = True
    assert panel.training_lines(job)[0] == "the run is over after 3:07"
