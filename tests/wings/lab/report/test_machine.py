"""The machine's facts are those of the system, and none of them says whose it is."""

import json
import os
import platform
import re
import socket
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from deformrf.wings.lab.report import machine
from deformrf.wings.lab.report.contents import Report
from deformrf.wings.lab.report.writing import write

COMMAND = "deformrf report helmet.npz --quick"


@pytest.fixture
def model(tmp_path):
    path = tmp_path / "helmet.npz"
    path.write_bytes(b"a model")
    return path


def facts(section):
    (table,) = section.tables
    assert table.name == section.key == "machine"
    values = {fact.what: fact.value for fact in table.rows}
    assert len(values) == len(table.rows) and all(values.values())
    return values


def test_versions_and_command_are_there(device, model):
    section = machine.section(device, COMMAND, model)
    values = facts(section)
    assert values["numpy"] == np.__version__ and values["warp-lang"] == wp.__version__
    assert values["torch"] == metadata.version("torch")
    assert values["Python"] == platform.python_version()
    assert values["command"] == COMMAND and section.values == {"device": device}
    assert len(section.findings) == 1 and values["CPU"] in section.findings[0]
    assert ("GPU" in values) == (device != "cpu")


def test_a_report_needs_no_torch(model, monkeypatch):
    """The extra "report" has none."""
    version = metadata.version

    def without(package):
        if package == "torch":
            raise metadata.PackageNotFoundError(package)
        return version(package)

    monkeypatch.setattr(metadata, "version", without)
    assert facts(machine.section("cpu", COMMAND, model))["torch"] == "not installed"


def test_cores_are_those_of_this_process(model):
    values = facts(machine.section("cpu", COMMAND, model))
    assert 1 <= int(values["usable cores"]) <= os.cpu_count()
    loads = [float(load) for load in values["load over 1, 5 and 15 min"].split(",")]
    assert len(loads) == 3 and min(loads) >= 0.0


@pytest.mark.gpu
def test_the_gpu_is_the_one_that_warp_has(model):
    values = facts(machine.section("cuda:0", COMMAND, model))
    gpu = wp.get_device("cuda:0")
    assert values["GPU"] == gpu.name
    assert re.fullmatch(r"driver \d+\.\d+, Warp \d+\.\d+", values["CUDA"])


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        (COMMAND, COMMAND),
        ("deformrf report model.npz -o ../out", "deformrf report model.npz -o out"),
        (
            "/home/me/bin/deformrf-report /data/a.npz --data=/home/me/chair -o out",
            "deformrf-report a.npz --data=chair -o out",
        ),
        ("x '/home/some one/my model.npz'", "x 'my model.npz'"),
        ("x /a=b/m.npz --data=/home/a=b/chair a=b/m.npz", "x m.npz --data=chair m.npz"),
        ("x .gpu/models/chair.npz --data ../data/chair/ ./y", "x chair.npz --data chair y"),
        ("x -o . --device=cuda:0 /a/m=1.npz", "x -o . --device=cuda:0 m=1.npz"),
    ],
)
def test_a_command_has_no_folders(command, expected):
    assert machine.without_folders(command) == expected
    assert machine.without_folders(expected) == expected


def test_nothing_says_whose_machine_it_is(device, model, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path / "someone"))
    command = f"{Path.home()}/bin/deformrf-report {tmp_path}/model.npz -o {tmp_path}"
    section = machine.section(device, command, model)
    write(Report("Machine", {}, [section], True), tmp_path)
    for name in ("report.json", "report.html", "report.md", "machine.csv"):
        words = (tmp_path / name).read_text()
        for secret in (str(Path.home()), str(tmp_path.parent), socket.gethostname()):
            assert not re.search(rf"(?<!\w){re.escape(secret)}(?!\w)", words), (name, secret)
    values = json.loads((tmp_path / "report.json").read_text())["sections"]["machine"]
    for fact in values["tables"]["machine"]:
        assert not any(word.startswith("/") for word in fact["value"].split()), fact


def test_a_changed_model_is_told_from_another(model):
    before = facts(machine.section("cpu", COMMAND, model))["model, SHA-256"]
    model.write_bytes(b"another model")
    assert facts(machine.section("cpu", COMMAND, model))["model, SHA-256"] != before


def test_a_changed_source_is_told_from_another(tmp_path):
    """Kernels in C++ and CUDA are sources, too; what the interpreter leaves there is not."""
    names = ("a.py", "deep/b.cu", "deep/c.cpp")
    for name in (*names, "a.pyc", "d.txt"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(name)
    assert machine.sources(tmp_path) == [tmp_path / name for name in names]
    seen = {machine.digest(machine.sources(tmp_path))}
    for name in names:
        (tmp_path / name).write_text("changed")
        seen.add(machine.digest(machine.sources(tmp_path)))
    assert len(seen) == 4
