"""Training: what it keeps, how it learns, and that an interrupted run leaves a model."""

import signal
import threading
import time
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
import torch

from deformrf.core.definition import networks
from deformrf.core.definition.networks import is_occupied
from deformrf.core.field import FieldOptions, modelfile
from deformrf.core.geometry import a15_grid, face_components, tet_neighbours
from deformrf.core.render import in_space, views_of_rows
from deformrf.core.training import (
    UNTOLD,
    CheckpointError,
    evaluate,
    load_checkpoint,
    preset,
    trainer,
)
from deformrf.core.training.data.raybank import RayBank
from deformrf.core.training.meant import Meant
from deformrf.core.training.run.batch import Batch
from deformrf.core.training.run.distributed import ALONE, Workers
from deformrf.core.training.run.optimization import PAUSE_INTERVAL
from deformrf.core.training.run.training_field import TrainingField
from deformrf.core.training.train_options import PRESETS

SMALL = preset(
    "tiny", spacing=0.06, coarse_steps=60, fine_steps=80, samples_per_step=2**13, level_count=3
)
# Enough where runs are compared to the last bit, and not with the ball.
BRIEF = replace(
    SMALL,
    spacing=0.1,
    march_step=0.02,
    table_size_log2=12,
    coarse_steps=40,
    fine_steps=48,
    samples_per_step=2**11,
)


@pytest.fixture(scope="module")
def trained(ball_data):
    return trainer.train(ball_data[0], SMALL, "cpu", "ball")


@pytest.fixture(scope="module")
def brief(ball_data):
    """A run of BRIEF that nothing interrupts."""
    return trainer.train(ball_data[0], BRIEF, "cpu", "ball")


def before_surroundings(ball_data, left_out=(), workers=ALONE):
    """A short run on the ball's photographs without alpha; nothing is sought."""
    pixels = ball_data[0].pixels.copy()
    pixels[:, 3] = 255
    choices = {"leave_out": left_out, "scene_radius": 1.5, "surroundings": "learnt"}
    choices |= {"coarse_steps": 20, "fine_steps": 4, "samples_per_step": 2**10}
    data, options = replace(ball_data[0], pixels=pixels), replace(BRIEF, **choices)
    return trainer.train(data, options, "cpu", workers=workers)


@pytest.mark.parametrize("error", [KeyboardInterrupt(), MemoryError(), ValueError("no flow")])
def test_a_cut_that_fails_leaves_the_model_whole(ball_data, monkeypatch, capsys, error):
    def meant(field, poses, place):
        raise error

    monkeypatch.setattr(trainer, "meant", meant)
    run = before_surroundings(ball_data)
    assert run.complete and run.uncut is None and run.field.mesh.tet_count > 0
    assert "The model keeps all that the object touches" in "".join(capsys.readouterr())


class Awaited(Workers):
    """A single worker whose signals wait as if others waited for it."""

    @contextmanager
    def stopping_together(self):
        self.count = 2
        with super().stopping_together():
            self.count = 1
            yield


def test_ctrl_c_ends_the_cut_where_several_workers_have_trained(ball_data, monkeypatch, capsys):
    monkeypatch.setattr(trainer, "meant", lambda *_: signal.raise_signal(signal.SIGINT))
    run = before_surroundings(ball_data, workers=Awaited())
    assert run.complete and run.uncut is None and run.field.mesh.tet_count > 0
    assert "The model keeps all that the object touches" in "".join(capsys.readouterr())


@pytest.mark.parametrize("left_out", [(), ("isolation",)])
def test_what_photographs_mean_is_cut_out_and_the_uncut_field_is_kept(
    ball_data, monkeypatch, left_out
):
    """Of photographs without alpha, and unless it is left out."""
    looked = []

    def meant(field, poses, place):
        looked.append((field, poses, place))
        return Meant(replace(field, meta={"cut": True}), 0.25)

    monkeypatch.setattr(trainer, "meant", meant)
    run = before_surroundings(ball_data, left_out)
    if left_out:
        assert not looked and run.uncut is None
        return
    field, poses, place = looked[0]
    assert run.uncut is field and run.field.meta == {"cut": True} and run.left_out == 0.25
    assert poses.shape == ball_data[0].poses.shape and place.shape == (3,)


def test_what_alpha_tells_is_not_cut(ball_data, monkeypatch):
    monkeypatch.setattr(trainer, "meant", lambda *given: pytest.fail("it was looked at"))
    assert trainer.train(ball_data[0], BRIEF, "cpu").uncut is None


def test_a_ball_is_learnt_from_its_pictures(ball_data, trained):
    """Shape, color and what is kept; numbers far above what a blank field scores."""
    field = trained.field
    assert not trained.interrupted
    report = evaluate(field, ball_data[1])
    assert report["mean"]["psnr"] > 22.0  # white alone: about 10 dB
    assert report["mean"]["alpha_error"] < 0.07  # without an object: 0.16

    middles = field.mesh.rest_vertices[field.mesh.tets].mean(axis=1)
    radius = np.linalg.norm(middles - 0.5, axis=1) * 2 * 1.488
    assert radius.max() < 0.8 + 0.6  # far tets are gone
    assert (radius < 0.4).any()  # and what the surface encloses is kept
    assert len(set(face_components(field.neighbours))) == 1


def test_half_precision_in_the_file_costs_nothing_visible(ball_data, trained, tmp_path):
    _, test_set = ball_data
    modelfile.save(trained.field, tmp_path / "ball.npz")
    before = evaluate(trained.field, test_set)["mean"]["psnr"]
    after = evaluate(modelfile.load(tmp_path / "ball.npz"), test_set)["mean"]["psnr"]
    assert abs(after - before) < 0.05


@pytest.mark.parametrize("after", [5, 55])
def test_an_interrupt_leaves_the_field_as_it_is(ball_data, monkeypatch, after):
    """In stage 1 and in stage 2."""
    Interrupting(monkeypatch, after)
    trained = trainer.train(ball_data[0], BRIEF, "cpu", "ball")
    assert trained.interrupted
    assert trained.report["interrupted"]
    assert ("tet_count" in trained.report) == (after > BRIEF.coarse_steps)
    assert np.isfinite(trained.field.table).all()


def test_an_interrupt_in_the_last_look_leaves_the_field_as_it_is(ball_data, monkeypatch):
    looks = 0
    hide_unseen = TrainingField.hide_unseen

    def interrupting(self, *arguments):
        nonlocal looks
        looks += 1
        if looks == 2:
            raise KeyboardInterrupt
        hide_unseen(self, *arguments)

    monkeypatch.setattr(TrainingField, "hide_unseen", interrupting)
    trained = trainer.train(ball_data[0], BRIEF, "cpu", "ball")
    assert trained.interrupted
    assert trained.field.options.level_count == BRIEF.level_count
    assert trained.field.mesh.tet_count == trained.report["tet_count"]
    views, field = ball_data[0], trained.field
    cameras = views_of_rows(field.meta["views"], views.lenses[0].width)
    wanted = in_space(views.poses, field.world_to_model)
    np.testing.assert_allclose([c.camera_to_world for c in cameras], wanted, atol=1e-5)
    assert [c.height for c in cameras] == [lens.height for lens in views.lenses]


@pytest.mark.soak
def test_without_view_dependence_all_sides_look_alike(ball_data):
    """The color of a sample is the same in all directions, and the ball is still learnt."""
    options = replace(SMALL, view_dependence=False)
    trained = trainer.train(ball_data[0], options, "cpu", "ball")
    field = trained.field
    assert not field.options.view_dependence
    rng = np.random.default_rng()
    tet, bary = rng.integers(field.mesh.tet_count, size=50), rng.dirichlet(np.ones(4), 50)
    h, defined = networks.geometry(field.definition, tet, bary), field.definition.color_layers
    colors = [networks.colors(h, np.tile(d, (50, 1)), defined) for d in np.eye(3)]
    np.testing.assert_array_equal(colors[0], colors[1])
    np.testing.assert_array_equal(colors[0], colors[2])
    # Slower to learn at first; white alone has 10 dB.
    assert evaluate(field, ball_data[1])["mean"]["psnr"] > 17.0


def test_who_watches_a_run_neither_changes_it_nor_costs_it_time(ball_data, brief):
    """Every pause of both stages is told, with the field as it stands then."""
    calls = []

    def look(pause):
        field = pause.export()
        assert field.options.level_count == BRIEF.level_count
        assert pause.step_count == (BRIEF.coarse_steps, BRIEF.fine_steps)[pause.stage - 1]
        assert (pause.history[-1]["stage"], pause.history[-1]["step"]) == (pause.stage, pause.step)
        assert pause.samples_per_second > 0.0
        calls.append((pause.stage, pause.seconds, field.table))
        time.sleep(0.2)

    begin = time.perf_counter()
    watched = trainer.train(ball_data[0], BRIEF, "cpu", "ball", on_pause=look)
    elapsed = time.perf_counter() - begin
    pauses = [(steps - 1) // PAUSE_INTERVAL for steps in (BRIEF.coarse_steps, BRIEF.fine_steps)]
    assert [stage for stage, *_ in calls] == [1] * pauses[0] + [2] * pauses[1]
    seconds = [when for _, when, _ in calls]
    assert seconds == sorted(seconds)
    assert seconds[-1] < watched.report["seconds"] < elapsed - 0.2 * len(calls)
    assert not np.array_equal(calls[-2][2], calls[-1][2])
    for a, b in zip(parameters(brief), parameters(watched), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.soak
def test_without_the_coarse_stage_the_whole_grid_learns(ball_data, monkeypatch, tmp_path):
    """One stage with all steps and levels; what it leaves is a model, and can be resumed."""
    options = replace(SMALL, leave_out=("coarse-stage",))
    path = tmp_path / "ball.checkpoint"
    with monkeypatch.context() as patch:
        Interrupting(patch, 40)
        assert trainer.train(ball_data[0], options, "cpu", "ball", path).interrupted
    trained = trainer.train(
        ball_data[0], options, "cpu", "ball", path, resumed=load_checkpoint(path)
    )
    assert trained.complete
    field = trained.field
    assert field.mesh.tet_count == a15_grid(SMALL.spacing).tet_count == trained.report["tet_count"]
    assert field.options.level_count == SMALL.level_count
    assert not any(key.startswith("stage_1") for key in trained.report)
    modelfile.save(field, tmp_path / "ball.npz")
    assert evaluate(modelfile.load(tmp_path / "ball.npz"), ball_data[1])["mean"]["psnr"] > 17.0


def test_without_a_subtet_mask_tets_are_occupied_as_a_whole(ball_data, trained):
    options = replace(SMALL, leave_out=("subtet-mask",))
    whole = trainer.train(ball_data[0], options, "cpu", "ball")
    full = np.uint64(2**64 - 1)
    assert set(whole.field.occupancy.tolist()) == {0, int(full)}
    assert not np.isin(trained.field.occupancy, [0, full]).all()


def test_a_tet_is_occupied_whole_if_any_of_its_subtets_is():
    options = FieldOptions(level_count=2, table_size=2**8)
    stage = TrainingField(a15_grid(0.25), options, "cpu", subtet_mask=False)
    with torch.no_grad():
        stage.networks.density[-1].bias[0] = 8.0
    stage.hidden[:] = True
    stage.hidden[3, 17] = stage.hidden[5, 40] = False
    stage.update_occupancy()
    assert stage.occupied.all(dim=1).nonzero().ravel().tolist() == [3, 5]
    assert stage.mask.numpy().nonzero()[0].tolist() == [3, 5]
    assert stage.occupied.sum() == 2 * 64


@pytest.mark.soak
def test_without_dense_levels_a_ball_is_learnt_from_hashed_ones(ball_data, trained):
    options = replace(SMALL, leave_out=("dense-levels",))
    hashed = trainer.train(ball_data[0], options, "cpu", "ball").field
    assert hashed.layout.dense_level_count == 0 < trained.field.layout.dense_level_count
    assert evaluate(hashed, ball_data[1])["mean"]["psnr"] > 20.0


class Interrupting:
    """Ctrl-C at the n-th step's draw in this thread; others may still end a run of their own."""

    def __init__(self, monkeypatch, after):
        self.draws, self.after, self.draw = 0, after, RayBank.draw
        self.thread = threading.get_ident()
        monkeypatch.setattr(RayBank, "draw", lambda *args, **named: self(*args, **named))

    def __call__(self, bank, *arguments, **named):
        ours = threading.get_ident() == self.thread
        self.draws += ours and len(arguments) == 2  # looks also give pixels, or None
        if ours and self.draws > self.after:
            raise KeyboardInterrupt
        self.draw(bank, *arguments, **named)


def parameters(trained):
    field = trained.field
    layers = [a for pair in (*field.density_layers, *field.color_layers) for a in pair]
    return [field.table, *layers, field.occupancy]


def test_the_same_seed_gives_the_same_model(ball_data, brief):
    """On the CPU to the last bit; CUDA adds gradients in any order."""
    again = trainer.train(ball_data[0], BRIEF, "cpu", "ball")
    for a, b in zip(parameters(brief), parameters(again), strict=True):
        np.testing.assert_array_equal(a, b)
    other = trainer.train(ball_data[0], replace(BRIEF, seed=1), "cpu", "ball")
    assert other.field.table.shape != brief.field.table.shape or not np.array_equal(
        other.field.table, brief.field.table
    )


@pytest.mark.parametrize("after", [27, 40 + 29])
def test_a_resumed_run_ends_where_an_uninterrupted_one_does(
    ball_data, brief, monkeypatch, tmp_path, capsys, after
):
    """Interrupted in stage 1 and in stage 2; the checkpoint goes through its file."""
    path = tmp_path / "ball.checkpoint"
    with monkeypatch.context() as patch:
        Interrupting(patch, after)
        first = trainer.train(ball_data[0], BRIEF, "cpu", "ball", path)
    assert first.interrupted
    resumed = load_checkpoint(path)
    assert (resumed.stage, resumed.fit["step"]["number"]) == ((1, 27) if after < 40 else (2, 29))
    assert resumed.options == BRIEF
    capsys.readouterr()
    whole = trainer.train(ball_data[0], resumed.options, "cpu", "ball", path, resumed)
    assert whole.complete
    place = "step 27 of 40 of stage 1" if after < 40 else "step 29 of 48 of stage 2"
    assert f"Going on from {place}." in capsys.readouterr().out
    assert whole.report["seconds"] > first.report["seconds"]
    for a, b in zip(parameters(brief), parameters(whole), strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_resumed_run_keeps_the_corner_orders_of_its_checkpoint(ball_data, monkeypatch, tmp_path):
    """Its features and masks belong to them; another version's grid may have others."""
    path = tmp_path / "ball.checkpoint"
    grid = trainer.a15_grid(BRIEF.spacing)
    other = replace(grid, tets=grid.tets[:, [0, 2, 3, 1]])
    with monkeypatch.context() as patch:
        patch.setattr(trainer, "a15_grid", lambda _: other)
        Interrupting(patch, 2)
        first = trainer.train(ball_data[0], BRIEF, "cpu", "ball", path)
    with monkeypatch.context() as patch:
        Interrupting(patch, 2)
        resumed = load_checkpoint(path)
        second = trainer.train(ball_data[0], BRIEF, "cpu", "ball", path, resumed)
    np.testing.assert_array_equal(second.field.mesh.tets, first.field.mesh.tets)


@pytest.mark.parametrize("change", ["more", "others", "told"])
def test_a_run_is_not_resumed_with_other_masks(ball_data, monkeypatch, tmp_path, change):
    """What is learned behind pixels that they leave untold belongs to these pixels."""
    pixels, path = ball_data[0].pixels.copy(), tmp_path / "ball.checkpoint"
    pixels[:4000:10, 3] = UNTOLD
    options = replace(BRIEF, scene_radius=1.5)
    rings = np.zeros(ball_data[0].view_count, int)
    masked = replace(ball_data[0], pixels=pixels, masked=True, rings=rings)
    with monkeypatch.context() as patch:
        Interrupting(patch, 2)
        trainer.train(masked, options, "cpu", "ball", path)
    with monkeypatch.context() as patch:
        Interrupting(patch, 2)
        same = trainer.train(masked, options, "cpu", "ball", path, load_checkpoint(path))
    assert same.interrupted
    mended = pixels.copy()
    if change != "more":
        mended[:4000:10, 3] = 255
    if change != "told":
        mended[5:4005:10, 3] = UNTOLD
    other = replace(masked, pixels=mended)
    with pytest.raises(CheckpointError, match="the masks have changed since the run was inter"):
        trainer.train(other, options, "cpu", "ball", path, load_checkpoint(path))


def test_a_long_run_is_saved_from_time_to_time(ball_data, monkeypatch, tmp_path):
    monkeypatch.setattr(trainer, "CHECKPOINT_SECONDS", 0.0)
    path = tmp_path / "ball.checkpoint"
    trained = trainer.train(ball_data[0], BRIEF, "cpu", "ball", path)
    assert trained.complete
    saved = load_checkpoint(path)
    last = (BRIEF.fine_steps - 1) // PAUSE_INTERVAL * PAUSE_INTERVAL
    assert (saved.stage, saved.fit["step"]["number"]) == (2, last)


def test_an_unknown_preset_is_named_with_the_known_ones():
    with pytest.raises(ValueError, match=r"'huge'.*default"):
        preset("huge")
    assert set(PRESETS) == {"default", "fast", "small", "tiny"}
    assert preset("tiny", seed=5).seed == 5


def test_occupancy_follows_density():
    """Sub-tets of a field whose density has been switched off are forgotten."""
    stage = TrainingField(a15_grid(0.2), FieldOptions(level_count=2, table_size=2**8), "cpu")
    with torch.no_grad():
        stage.networks.density[-1].bias[0] = 8.0
    stage.update_occupancy()
    assert stage.occupied.all()
    with torch.no_grad():
        stage.networks.density[-1].bias[0] = -8.0
    for _ in range(250):  # 0.95 to that power takes 6 below 1e-4
        stage.update_occupancy()
    assert not stage.occupied.any()


def column_of_rays(stage, alpha):
    """A marched batch of rays from above, whose pixels have that alpha.  [R] or a number"""
    places = np.stack(np.meshgrid(*[np.linspace(0.05, 0.95, 60)] * 2), axis=-1).reshape(-1, 2)
    batch = Batch(len(places), None, stage.device)
    origins = np.column_stack([places, np.full(len(places), 3.0)]).astype(np.float32)
    batch.origins.copy_(torch.from_numpy(origins))
    batch.directions.copy_(torch.tensor([0.0, 0.0, -1.0]).expand(len(places), 3))
    batch.rgba[:, 3] = torch.as_tensor(alpha(places) if callable(alpha) else alpha)
    return batch


def test_what_pixels_refute_is_hidden_tet_by_tet():
    """A thin fog: half of its pixels show nothing there, the others as much as it weighs."""
    stage = TrainingField(a15_grid(0.1), FieldOptions(level_count=2, table_size=2**8), "cpu")
    with torch.no_grad():
        stage.networks.density[-1].bias[0] = -2.0
    batch = column_of_rays(stage, lambda places: np.where(places[:, 0] < 0.5, 0.0, 0.1))
    stage.march(batch)
    samples, weights = batch.samples, stage.composite(batch).weights
    ray = np.repeat(np.arange(batch.ray_count), batch.counts.numpy())
    too_low = batch.rgba[:, 3].numpy()[ray] < 0.5 * weights.numpy()
    tet, count = samples.tet.numpy(), stage.mesh.tet_count
    matter = np.bincount(tet, weights.numpy().astype(float), count)
    refuted = np.bincount(tet, weights.numpy() * too_low, count)
    expected = refuted > 0.5 * matter
    assert 0.2 < expected.mean() < 0.8
    assert (np.abs(refuted - 0.5 * matter)[matter > 0] > 1e-6).all()
    batches = [batch]
    stage.hide_unseen(lambda _: batches, 0.0)
    assert not stage.hidden.any()
    stage.hide_unseen(lambda _: batches, 0.0, with_refuted=True)
    np.testing.assert_array_equal(stage.hidden.numpy(), np.repeat(expected[:, None], 64, axis=1))
    assert not (stage.occupied & stage.hidden).any()


@pytest.mark.parametrize("alpha", [0.05, 1.0])
def test_what_is_as_faint_as_its_pixels_stays(alpha):
    """A veil, and fog that is always before the object."""
    stage = TrainingField(a15_grid(0.1), FieldOptions(level_count=2, table_size=2**8), "cpu")
    with torch.no_grad():
        stage.networks.density[-1].bias[0] = -3.0
    batch = column_of_rays(stage, alpha)
    stage.hide_unseen(lambda _: [batch], 0.0, with_refuted=True)
    assert not stage.hidden.any()


def test_what_no_ray_sees_is_hidden():
    """An opaque field seen from one side: only its front remains."""
    stage = TrainingField(a15_grid(0.2), FieldOptions(level_count=2, table_size=2**8), "cpu")
    with torch.no_grad():
        stage.networks.density[-1].bias[0] = 9.0
    rng = np.random.default_rng()
    origins = np.column_stack([rng.uniform(0.1, 0.9, (4000, 2)), np.full(4000, 3.0)])
    directions = np.broadcast_to([0.0, 0.0, -1.0], (4000, 3))
    batch = Batch(len(origins), None, stage.device)
    for mine, given in ((batch.origins, origins), (batch.directions, directions)):
        mine.copy_(torch.from_numpy(given.astype(np.float32)))
    stage.hide_unseen(lambda _: [batch], 1e-3)
    field = stage.export(np.eye(4), {})
    tet = np.repeat(np.arange(field.mesh.tet_count), 20)
    bary = rng.dirichlet(np.ones(4), len(tet))
    occupied = is_occupied(field.occupancy, tet, bary)
    height = np.einsum("nc,nc->n", bary, field.mesh.rest_vertices[field.mesh.tets[tet]][..., 2])
    assert occupied.any()
    assert height[occupied].min() > 0.7  # the grid ends above 1
    assert tet_neighbours(field.mesh.tets).shape == field.neighbours.shape
