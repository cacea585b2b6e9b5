"""deformrf report on a tiny model: numbers are there, finite and consistent; errors are told."""

import csv
import json
from dataclasses import replace
from math import isfinite
from pathlib import Path

import numpy as np
import pytest

from deformrf.commands import report as command
from deformrf.commands.running import INPUT_ERROR, INTERRUPTED, run
from deformrf.core.deform import XpbdSolver
from deformrf.core.field import BASIS_COUNT, FieldOptions, modelfile, random_field
from deformrf.core.geometry import TetMesh, tet_neighbours
from deformrf.wings.lab.effort import EFFORTS
from deformrf.wings.lab.rendering.pictures import PEAK_DB
from deformrf.wings.lab.rendering.section import BOUND, LARGEST
from deformrf.wings.lab.stability import section as stability

# A time is measured once where a number is enough.
LEAST = EFFORTS[True, True]._replace(turns=1, frame_turns=2, step_turns=2, start_turns=1)
SECTIONS = ["rendering", "dynamics", "training", "stability", "left_out", "machine"]


@pytest.fixture(scope="module", params=["cpu", pytest.param("cuda", marks=pytest.mark.gpu)])
def folder(request, ball_file, tmp_path_factory):
    """What a quick report on the ball writes."""
    folder = tmp_path_factory.mktemp("report")
    arguments = command.ReportArguments(ball_file, folder, device=request.param, quick=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(EFFORTS, (request.param == "cpu", True), LEAST)
        assert command.prepare(arguments)() == 0
    return folder


@pytest.fixture(scope="module")
def report(folder):
    def refuse(word):
        raise AssertionError(f"{word} is no JSON")

    return json.loads((folder / "report.json").read_text(), parse_constant=refuse)


def table(report, key, name=None):
    return report["sections"][key]["tables"][name or key]


def test_every_section_is_there(report, folder):
    assert report["complete"] and list(report["sections"]) == SECTIONS
    for key, section in report["sections"].items():
        assert section["findings"] and section["title"], key
        assert (section["seconds"] is None) == (key == "machine")
    page = (folder / "report.html").read_text()
    for name in ("rendering", "dynamics", "stability", "left_out"):
        if name != "stability":
            assert (folder / f"{name}.png").read_bytes()[:4] == b"\x89PNG"
        with open(folder / f"{name}.csv", newline="") as file:
            assert len(list(csv.DictReader(file))) == len(table(report, name))
        assert report["sections"][name]["title"] in page


def test_rendering_s_numbers_are_consistent(report):
    rows = {row["setting"]: row for row in table(report, "rendering")}
    for row in rows.values():
        assert 0 < row["frame_ms_low"] <= row["frame_ms"] <= row["frame_ms_high"] < 1e5
        assert row["worst_psnr"] <= row["psnr"] + 1e-9 and row["psnr"] <= PEAK_DB
        assert 0 <= row["largest"] <= 255
        assert row["relative_percent_low"] <= row["relative_percent"] > 0
        assert (row["largest_anywhere"] is None) == (row["setting"] == "conformance")
    assert [row["setting"] for row in rows.values() if row["default"]] == ["default"]
    assert rows["conformance"]["psnr"] > rows["default"]["psnr"] > rows["stop 0.2"]["psnr"]
    # Rays get samples by rounds, so a few of them may have as many whenever they end.
    assert rows["stop 0"]["samples"] >= rows["default"]["samples"] >= rows["stop 0.2"]["samples"]
    assert rows["stop 0"]["samples"] > rows["stop 0.2"]["samples"]
    assert rows["step × 4"]["psnr"] < rows["step × 2"]["psnr"]
    assert rows["default"]["relative_percent"] == 100
    for row in (row for row in rows.values() if row["chosen"]):
        assert row["candidate"] and row["worst_psnr"] >= BOUND
        assert max(row["largest"], row["largest_anywhere"]) <= LARGEST
        for other in rows.values():  # nothing that is as good is cheaper
            good = other["candidate"] and other["worst_psnr"] >= BOUND
            good = good and max(other["largest"], other["largest_anywhere"]) <= LARGEST
            assert not good or other["relative_percent"] >= row["relative_percent"]
    values = report["sections"]["rendering"]["values"]
    assert 20 < values["reference_psnr"] <= PEAK_DB


def test_the_dynamics_error_falls_with_substeps(report):
    rows = table(report, "dynamics")
    for scene in ("static", "dynamic"):
        own = [(row["count"], row["of_motion"]) for row in rows if row["scene"] == scene]
        counts, errors = np.array(sorted(own)).T
        assert len(counts) >= 4 and (np.diff(errors) < 0).all(), (scene, own)
        assert errors[-1] < errors[0] / 4
    assert all(row["frame_ms"] > 0 for row in rows)
    recommended = report["sections"]["dynamics"]["values"]["recommended_substeps"]
    assert recommended in counts


def test_all_stress_cases_pass(report):
    rows = [*table(report, "stability"), *table(report, "stability", "poses")]
    assert report["sections"]["stability"]["passed"]
    assert all(row["passed"] for row in rows) and len(rows) > 20
    for row in table(report, "stability"):
        assert row["nan_count"] == 0 and isfinite(row["error"])
        assert row["recovery_seconds"] is None or row["recovery_seconds"] <= row["limit"]


def test_each_omission_was_measured(report):
    rows = table(report, "left_out")
    assert {row["group"] for row in rows} == {"rendering", "dynamics", "file", "start"}
    for row in rows:
        for column in ("with_it", "without", "saving"):
            assert isfinite(row[column]) and row[f"{column}_repeats"] >= 1
        assert row["change"] and row["verdict"] and row["why"]


def test_the_machine_is_named_without_its_folders(report, ball_file):
    text = json.dumps(report)
    assert str(ball_file.parent) not in text
    facts = {row["what"]: row["value"] for row in table(report, "machine")}
    assert facts["numpy"] and facts["command"].startswith("deformrf report")


class FlippedSolver(XpbdSolver):
    """Pushes where it should pull: the double that a report has to see through."""

    def step(self, dt):
        before = self.vertices.numpy().astype(float)
        super().step(dt)
        after = self.vertices.numpy().astype(float)
        self.vertices.assign((2.0 * before - after).astype(np.float32))


def test_a_solver_with_a_flipped_sign_fails(ball):
    """Run against the very cases that the real one passes."""
    section = stability.section(ball, "cpu", quick=True, make_solver=FlippedSolver)
    rows = section.tables[0].rows
    failed = [row for row in rows if not row.passed]
    assert section.passed is False and len(failed) >= len(rows) / 2
    assert sum(finding.startswith("FAILED") for finding in section.findings) == len(failed)
    assert f"{len(rows) - len(failed)} of {len(rows)} stress cases" in section.findings[0]


def test_ctrl_c_keeps_what_is_done(ball_file, tmp_path, monkeypatch, capsys):
    whole = command.plan

    def interrupted(*arguments):
        jobs = whole(*arguments)

        def stop(step):
            step(0.5)
            raise KeyboardInterrupt

        training = next(job for job in jobs if job.title == "training")
        return [training, jobs[0]._replace(section=stop), *jobs[1:]]

    monkeypatch.setattr(command, "plan", interrupted)
    arguments = command.ReportArguments(ball_file, tmp_path, device="cpu", quick=True)
    assert run("deformrf report", lambda: command.prepare(arguments)) == INTERRUPTED
    kept = json.loads((tmp_path / "report.json").read_text())
    assert not kept["complete"] and list(kept["sections"]) == ["training", "machine"]
    assert "interrupted" in (tmp_path / "report.md").read_text()
    assert "report.html" in capsys.readouterr().out


def test_ctrl_c_keeps_an_older_report(ball_file, tmp_path, monkeypatch, capsys):
    """What is done lies beside it; nothing does if nothing is."""
    whole = command.plan

    def interrupted(*arguments):
        def stop(step):
            raise KeyboardInterrupt

        jobs = whole(*arguments)
        training = next(job for job in jobs if job.title == "training")
        return [*[training] * done, jobs[0]._replace(section=stop)]

    arguments = command.ReportArguments(ball_file, tmp_path / "r", device="cpu", quick=True)
    monkeypatch.setattr(command, "plan", lambda *a: [])
    assert command.prepare(arguments)() == 0
    old = (tmp_path / "r" / "report.html").read_bytes()
    monkeypatch.setattr(command, "plan", interrupted)
    for done in (0, 1):
        assert run("deformrf report", lambda: command.prepare(arguments)) == INTERRUPTED
        assert (tmp_path / "r" / "report.html").read_bytes() == old
        assert (tmp_path / "r-interrupted").exists() == bool(done)
    said = capsys.readouterr()
    assert said.err == "deformrf report: interrupted\n" * 2 and "Missing: rendering" in said.out
    monkeypatch.chdir(tmp_path / "r")  # a folder without a name
    here = replace(arguments, output=Path())
    assert run("deformrf report", lambda: command.prepare(here)) == INTERRUPTED
    assert (tmp_path / "r" / "report.html").read_bytes() == old
    kept = json.loads((tmp_path / "r-interrupted" / "report.json").read_text())
    assert list(kept["sections"]) == ["training", "machine"]


def test_a_failure_on_the_way_keeps_what_is_done(ball_file, tmp_path, monkeypatch):
    whole = command.plan

    def failing(*arguments):
        def fail(step):
            raise RuntimeError("out of luck")

        jobs = whole(*arguments)
        training = next(job for job in jobs if job.title == "training")
        return [training, jobs[0]._replace(section=fail)]

    monkeypatch.setattr(command, "plan", failing)
    arguments = command.ReportArguments(ball_file, tmp_path, device="cpu", quick=True)
    with pytest.raises(RuntimeError, match="out of luck"):
        command.prepare(arguments)()
    kept = json.loads((tmp_path / "report.json").read_text())
    assert not kept["complete"] and list(kept["sections"]) == ["training", "machine"]


def test_a_folder_in_a_file_s_place_is_named(ball_file, tmp_path, monkeypatch, capsys):
    """As on a disk that is full, or with a table that another program holds open."""
    (tmp_path / "training.csv").mkdir()
    monkeypatch.setattr(command, "plan", lambda *a: [])
    arguments = command.ReportArguments(ball_file, tmp_path, device="cpu", quick=True)
    (tmp_path / "machine.csv").mkdir()
    assert command.prepare(arguments)() == INPUT_ERROR
    assert "machine.csv" in capsys.readouterr().err


@pytest.mark.soak
def test_one_tet_is_enough(tmp_path, monkeypatch):
    """And one level, no view dependence, no word on training: the least that a model can be."""
    mesh = TetMesh(
        np.array([[0.3, 0.3, 0.3], [0.7, 0.3, 0.3], [0.5, 0.7, 0.3], [0.5, 0.5, 0.7]]),
        np.array([[0, 0, 0], [4, 0, 0], [2, 4, 0], [2, 2, 4]], np.int32),
        np.array([[0, 1, 2, 3]], np.int32),
    )
    options = FieldOptions(1, 2**8, (16,), (16,), march_step=0.02, view_dependence=False)
    field = random_field(mesh, tet_neighbours(mesh.tets), options, contrast=2.0)
    weights = [(w.copy(), b) for w, b in field.color_layers]
    weights[0][0][-BASIS_COUNT + 1 :] = 0.0
    modelfile.save(replace(field, color_layers=tuple(weights)), tmp_path / "tet.npz")
    write_training(tmp_path / "tet.npz", "null")
    output = tmp_path / "report"
    monkeypatch.setitem(EFFORTS, (True, True), LEAST)
    arguments = command.ReportArguments(tmp_path / "tet.npz", output, device="cpu", quick=True)
    assert command.prepare(arguments)() == 0
    assert json.loads((output / "report.json").read_text())["complete"]


def write_training(path, text):
    """Make this JSON text the `training` entry of a model that says nothing there."""
    with np.load(path) as archive:
        arrays = dict(archive)
    meta = arrays["meta"].tobytes().decode()
    assert meta.endswith('"training": {}}')
    meta = f"{meta.removesuffix('{}}')}{text}}}"
    np.savez(path, **{**arrays, "meta": np.frombuffer(meta.encode(), np.uint8)})


def test_errors_are_sentences(call, tmp_path, ball, ball_file):
    missing = call(command.main, tmp_path / "none.npz", "-o", tmp_path / "report")
    assert missing.code == INPUT_ERROR and "none.npz" in missing.err
    modelfile.save(ball, tmp_path / "nested.npz")
    write_training(tmp_path / "nested.npz", "[" * 20_000 + "]" * 20_000)
    nested = call(command.main, tmp_path / "nested.npz", "-o", tmp_path / "report")
    assert nested.code == INPUT_ERROR and "nests too deeply" in nested.err
    (tmp_path / "file").write_text("in the way")
    taken = call(command.main, ball_file, "-o", tmp_path / "file")
    assert taken.code == INPUT_ERROR and "file" in taken.err
    no_data = call(command.main, ball_file, "-o", tmp_path / "r", "--data", tmp_path / "nothing")
    assert no_data.code == INPUT_ERROR and "nothing" in no_data.err


def test_another_model_is_compared(ball_file, make_ball_field, tmp_path, monkeypatch):
    field = replace(make_ball_field(5), meta={"options": {"leave_out": ["ray-color"]}})
    modelfile.save(field, tmp_path / "samples.npz")
    monkeypatch.setitem(EFFORTS, (True, True), LEAST)
    arguments = command.ReportArguments(
        ball_file, tmp_path / "r", device="cpu", quick=True, compare=tmp_path / "samples.npz"
    )
    effort, ball = EFFORTS[True, True], modelfile.load(ball_file)
    other = command.other_model(arguments, effort)
    jobs = command.plan(ball, arguments, "cpu", effort, None, other)
    assert jobs[-1].title == "another"
    monkeypatch.setattr(command, "plan", lambda *_: jobs[-1:])
    assert command.prepare(arguments)() == 0
    text = (tmp_path / "r" / "report.md").read_text()
    assert "all parts but ray-color" in text and "samples" in text


def test_photographs_are_compared(ball, ball_file, write_dataset, tmp_path):
    """Those of white paper: far from the ball, but measured."""
    from PIL import Image

    data = write_dataset(tmp_path, [Image.new("RGBA", (16, 12), (255, 255, 255, 255))] * 3)
    effort = EFFORTS[True, True]._replace(photo_count=2, photo_pixels=50)
    photos = command.photographs_for(ball, data, effort)
    assert len(photos) == 2 and min(photo.colors.min() for photo in photos) == 1.0
    assert command.photographs_for(ball, None, effort) is None
