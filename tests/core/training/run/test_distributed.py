"""Two processes that train together agree with one at the same total batch.

torchrun runs this file in two workers, over gloo on the CPU; with two GPUs also over NCCL.
"""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from deformrf.core.base.device import device_name
from deformrf.core.field import FieldOptions, modelfile
from deformrf.core.geometry import a15_grid
from deformrf.core.render import look_at
from deformrf.core.training import (
    TrainOptions,
    load_checkpoint,
    load_dataset,
    preset,
    torchrun_workers,
    trainer,
    world_to_unit_cube,
)
from deformrf.core.training.data.raybank import RayBank
from deformrf.core.training.run.adam import BETAS
from deformrf.core.training.run.differentiable import on_warp_stream
from deformrf.core.training.run.distributed import ALONE, Workers
from deformrf.core.training.run.optimization import LOSS_SCALE, Optimization
from deformrf.core.training.run.surroundings import LearnedSurroundings, random_surroundings
from deformrf.core.training.run.training_field import TrainingField

SIZE = 24
RAYS = 301  # two shares of it differ
STEPS, FIRST_STEPS = 40, 3
SMALL = {"spacing": 0.1, "level_count": 3, "table_size_log2": 12, "march_step": 0.02}
OPTIONS = preset("tiny", coarse_steps=40, fine_steps=40, samples_per_step=2**11, **SMALL)
INTERRUPTED_AFTER = 20  # steps


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_no_worker_of_several_stops_alone(number):
    """The others would wait for it; a signal that is ignored, as with nohup, stays so."""
    workers = Workers(0, 2)
    before = signal.signal(number, signal.default_int_handler)
    try:
        with workers.stopping_together():
            signal.raise_signal(number)
        signal.signal(number, signal.SIG_IGN)
        with workers.stopping_together():
            assert signal.getsignal(number) == signal.SIG_IGN
    finally:
        signal.signal(number, before)


def test_what_a_worker_does_alone_ends_at_the_first_signal():
    """The second one is torchrun's; one that came shortly before counts, too."""
    workers = Workers(0, 2)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with workers.stopping_together():
            with pytest.raises(KeyboardInterrupt), workers.working_alone():
                signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)
            with pytest.raises(KeyboardInterrupt), workers.working_alone():
                pytest.fail("it was interrupted before")
    finally:
        signal.signal(signal.SIGINT, before)


def make_run(dataset, device, workers, around=False):
    options = FieldOptions(level_count=3, table_size=2**10, march_step=0.02)
    surroundings = None
    if around:
        box = np.array([[0.2] * 3, [0.8] * 3])
        surroundings = LearnedSurroundings(random_surroundings(box), device)
    field = TrainingField(a15_grid(0.2), options, device, 0, surroundings, workers=workers)
    bank = RayBank(dataset, world_to_unit_cube(dataset, radius=1.5), device)
    options = TrainOptions(samples_per_step=2**15)
    run = Optimization(field, bank, options, dataset.has_alpha, STEPS, 1.0)
    run.set_ray_count(RAYS)
    return run


def gradients(run):
    """Of the first step's rays: this worker's own, and what it updates with."""
    batch = run.batch
    run._prepare(batch, 0)
    run._march(batch)
    numbers = batch.drawn.first + torch.arange(batch.ray_count, device=batch.tries.device)
    batch.tries.copy_(1 + numbers % 3 + 4 * (numbers < RAYS // 2))  # the first worker tried more
    run._backpropagate(batch)
    found = {"rays": batch.directions, "background": batch.background}
    found["samples"] = run.sample_count()
    exchange, count = run._exchange, len(run.field.table)
    if exchange is None:
        found["all"] = [p.grad / LOSS_SCALE for p in run.field.parameters()]
        found["own"] = found["all"][0]
        return found
    found["own"] = exchange._table_gradient[:count].float() / batch.pixels_tried() / LOSS_SCALE
    for function, _ in exchange.tasks(run.optimizer).values():
        function()
    part, *others = exchange.parameters
    table = exchange.whole(run.optimizer.state[part]["exp_avg"]) / (1.0 - BETAS[0])
    found["all"] = [g / LOSS_SCALE for g in (table, *(p.grad for p in others))]
    return found


def learn(dataset, device, workers):
    """Some steps: the errors, and the weights after the first ones and after all."""
    run = make_run(dataset, device, workers)
    errors, weights = [], []
    for _ in range(STEPS):
        run.step(1e-2, white=False)
        errors.append(float(run.error))
        if run.number in (FIRST_STEPS, STEPS):
            if run._exchange:
                run._exchange.make_whole()  # on CUDA a worker has its part only
            weights.append([p.detach().clone() for p in run.field.parameters()])
    return {"errors": errors, "first": weights[0], "last": weights[1]}


def train(dataset, device, workers, path=None, resumed=None):
    trained = trainer.train(dataset, OPTIONS, device, "ball", path, resumed, workers=workers)
    field = trained.field
    keys = ("workers", "stage_1_tet_count", "tet_count", "occupied_share", "history")
    return {
        "report": {key: trained.report.get(key) for key in keys},
        "interrupted": trained.interrupted,
        "table": torch.from_numpy(field.table),
        "occupancy": torch.from_numpy(field.occupancy.view(np.int64)),
    }


def all_of_it(folder, device, workers):
    dataset = load_dataset(folder / "data", "train")
    with on_warp_stream(device):
        result = {
            "gradients": gradients(make_run(dataset, device, workers)),
            "around": gradients(make_run(dataset, device, workers, around=True)),
            "learnt": learn(dataset, device, workers),
        }
    result["trained"] = train(dataset, device, workers)
    return result


def interrupted(folder, device, workers):
    """Ctrl-C reaches the second worker alone, between two pauses."""
    step = Optimization.step

    def interrupting(run, *arguments):
        if workers.rank == 1 and run.number == INTERRUPTED_AFTER:
            os.kill(os.getpid(), signal.SIGINT)
        step(run, *arguments)

    Optimization.step = interrupting
    dataset = load_dataset(folder / "data", "train")
    try:
        return train(dataset, device, workers, folder / f"{workers.rank}.checkpoint")
    finally:
        Optimization.step = step


def resumed(folder, device, workers):
    """The rest of the run that was interrupted."""
    workers.total(0)  # waits until the first has written the checkpoint
    dataset = load_dataset(folder / "data", "train")
    saved = load_checkpoint(folder / "0.checkpoint")
    return train(dataset, device, workers, resumed=saved)


def work(folder, choice):
    """What each worker does."""
    device = device_name(choice, for_training=True)
    with torchrun_workers(device) as workers:
        result = all_of_it(folder, device, workers)
        result["interrupted"] = interrupted(folder, device, workers)
        result["resumed"] = resumed(folder, device, workers)
        torch.save(result, folder / f"{workers.rank}.pt")


def torchrun(*arguments):
    """Two processes; what they printed."""
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone"]
    command += ["--nproc-per-node", "2", *map(str, arguments)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    return run.stdout


@pytest.fixture(scope="module")
def folder(tmp_path_factory, write_dataset):
    """An orange ball from 12 sides, in data/."""
    folder = tmp_path_factory.mktemp("distributed")
    x, y = np.meshgrid(*[np.arange(SIZE) - 0.5 * (SIZE - 1)] * 2)
    image = np.zeros((SIZE, SIZE, 4), np.uint8)
    image[np.hypot(x, y) < 0.27 * SIZE] = (230, 120, 20, 255)
    for split, count in (("train", 12), ("test", 2)):
        places = np.random.default_rng(count).normal(size=(count, 3))
        places *= 4.0 / np.linalg.norm(places, axis=1, keepdims=True)
        poses = [look_at(place, (0, 0, 0)) for place in places]
        write_dataset(folder / "data", [Image.fromarray(image)] * count, split, poses=poses)
    return folder


@pytest.fixture(scope="module", params=["cpu", pytest.param("cuda", marks=pytest.mark.gpu)])
def results(request, folder):
    """Of one process, and of each of two, with the folder that they wrote to."""
    if request.param == "cuda" and torch.cuda.device_count() < 2:
        pytest.skip("needs two CUDA devices")
    device = device_name(request.param, for_training=True)
    torchrun(__file__, folder, request.param)
    one = all_of_it(folder, device, ALONE)
    two = [torch.load(folder / f"{rank}.pt", map_location=device) for rank in range(2)]
    return one, two, device


def test_workers_draw_the_rays_of_one_process(results):
    """Each other ones, and each with the same background and jitter as there."""
    one, two, _ = results
    for scene in ("gradients", "around"):
        a, b = one[scene], [worker[scene] for worker in two]
        assert [len(worker["rays"]) for worker in b] == [RAYS // 2, RAYS - RAYS // 2]
        for name in ("rays", "background"):
            assert torch.equal(a[name], torch.cat([worker[name] for worker in b]))
        assert a["samples"] == b[0]["samples"] == b[1]["samples"] > 1000
    assert not torch.equal(b[0]["rays"], b[1]["rays"][: RAYS // 2])


def test_gradients_are_those_of_all_rays(results):
    """Up to the order of float32 sums (10⁻⁵ is seen); on CUDA the terms are of half precision."""
    one, two, device = results
    tolerance = 1e-4 if device == "cpu" else 1e-2
    for scene in ("gradients", "around"):
        for worker in two:
            for a, b in zip(one[scene]["all"], worker[scene]["all"], strict=True):
                assert a.abs().max() > 0.0
                assert (a - b).abs().max() < tolerance * a.abs().max()
            own, table = worker[scene]["own"], one[scene]["all"][0]
            assert (own - table).abs().max() > 0.05 * table.abs().max()


def test_workers_keep_the_same_weights(results):
    _, (a, b), _ = results
    for name in ("first", "last"):
        for mine, other in zip(a["learnt"][name], b["learnt"][name], strict=True):
            assert torch.equal(mine, other)
    assert a["learnt"]["errors"] == b["learnt"]["errors"]
    assert torch.equal(a["trained"]["table"], b["trained"]["table"])
    assert torch.equal(a["trained"]["occupancy"], b["trained"]["occupancy"])


def test_two_learn_what_one_learns(results):
    """Adam makes steps of one size from gradients of any: where they are all but zero, rounding
    decides.  So most weights agree at first, and the errors throughout: 10⁻³ is seen at the end.
    """
    one, (two, _), device = results
    if device == "cpu":
        for a, b in zip(one["learnt"]["first"], two["learnt"]["first"], strict=True):
            assert ((a - b).abs() > 1e-4).float().mean() < 1e-2
    errors = np.array([one["learnt"]["errors"], two["learnt"]["errors"]])
    np.testing.assert_allclose(*errors, rtol=1e-2 if device == "cpu" else 0.2)
    np.testing.assert_allclose(*errors[:, :FIRST_STEPS], rtol=1e-4 if device == "cpu" else 0.05)
    assert errors[:, -5:].mean() < 0.5 * errors[:, :5].mean()


def test_both_stages_keep_what_one_process_keeps(results):
    one, (two, _), device = results
    a, b = one["trained"]["report"], two["trained"]["report"]
    assert (a["workers"], b["workers"]) == (1, 2)
    assert b["stage_1_tet_count"] == a["stage_1_tet_count"]
    assert b["tet_count"] == pytest.approx(a["tet_count"], rel=0.05 if device == "cpu" else 0.2)
    assert b["occupied_share"] == pytest.approx(a["occupied_share"], abs=0.1)


def test_the_history_is_that_of_all_rays(results):
    """All workers know the same, and at first it is what one process knows."""
    one, two, device = results
    alone, *shared = (result["trained"]["report"]["history"] for result in (one, *two))
    places = [[(row["stage"], row["step"]) for row in rows] for rows in (alone, *shared)]
    assert places[0] == places[1] == places[2]
    psnr = [[row["psnr"] for row in rows] for rows in (alone, *shared)]
    assert psnr[1] == psnr[2]
    assert psnr[1][0] == pytest.approx(psnr[0][0], rel=1e-2 if device == "cpu" else 0.1)


def test_one_interrupt_stops_all_at_the_same_step(results, folder):
    """None waits for another for ever, and the first alone writes the checkpoint."""
    _, two, _ = results
    assert all(worker["interrupted"]["interrupted"] for worker in two)
    assert torch.equal(two[0]["interrupted"]["table"], two[1]["interrupted"]["table"])
    saved = load_checkpoint(folder / "0.checkpoint")
    assert INTERRUPTED_AFTER <= saved.fit["step"]["number"] < INTERRUPTED_AFTER + 16
    assert not (folder / "1.checkpoint").exists()


def test_a_run_of_two_is_resumed_by_two_and_by_one(results, folder):
    """The checkpoint has the optimizer's state of the whole table."""
    _, (a, b), device = results
    saved = load_checkpoint(folder / "0.checkpoint").fit
    for name in ("exp_avg", "exp_avg_sq"):
        moments = saved["step"]["optimizer"][0][name]
        assert moments.shape == saved["stage"]["parameters"][0].shape
        assert all(bool(half.any()) for half in moments.chunk(2))
    assert not a["resumed"]["interrupted"]
    assert torch.equal(a["resumed"]["table"], b["resumed"]["table"])
    alone = resumed(folder, device, ALONE)
    tolerance = 0.05 if device == "cpu" else 0.2
    tets = [result["report"]["tet_count"] for result in (alone, a["resumed"])]
    assert tets[0] == pytest.approx(tets[1], rel=tolerance)
    psnr = [result["report"]["history"][-1]["psnr"] for result in (alone, a["resumed"])]
    assert psnr[0] == pytest.approx(psnr[1], rel=tolerance)


def test_shares_are_all_there_is():
    for count in (1, 7, 300):
        shares = [Workers(rank, 4).share(count) for rank in range(4)]
        assert [i for share in shares for i in share] == list(range(count))
        assert max(map(len, shares)) <= min(map(len, shares)) + 1


def test_torchrun_trains_one_model(folder, tmp_path):
    """The command as the README has it: one file, one voice, scores."""
    script = Path(sys.executable).with_name("deformrf-train")
    flags = ["--preset", "tiny", "--steps", 20, "--leave-out", "coarse-stage", "--device", "cpu"]
    flags += ["--spacing", 0.1]
    said = torchrun("--no-python", script, folder / "data", "-o", tmp_path / "ball.npz", *flags)
    assert said.count("Wrote") == 1
    assert [p.name for p in tmp_path.iterdir()] == ["ball.npz"]
    meta = modelfile.load(tmp_path / "ball.npz").meta
    assert (meta["workers"], meta["test_view_count"]) == (2, 2)


if __name__ == "__main__":
    work(Path(sys.argv[1]), sys.argv[2])
    sys.stdout.flush()
    os._exit(0)  # as deformrf train ends a worker
