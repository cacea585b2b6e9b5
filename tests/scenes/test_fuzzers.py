"""The fuzzers find what they are made for: faults of every sort, and those that were put back."""

import importlib
import json
import subprocess
import sys

import numpy as np
import pytest

from deformrf.core.base.paths import ROOT

BENCHMARKS = ROOT / "tests" / "benchmarks"


@pytest.fixture
def fuzzing(monkeypatch):
    """The modules of the fuzzers, by name."""
    for folder in (BENCHMARKS, BENCHMARKS.parent / "support"):
        monkeypatch.syspath_prepend(folder)
    return lambda name: importlib.import_module(f"fuzzing.{name}")


PLANTED = """
import os, sys, time, json
from pathlib import Path
from fuzzing import watch

watch.LONGEST, watch.BLOCKED, watch.MOST_MEMORY = 0.5, 2.0, 100
ACTS = {
    "good": lambda: None,
    "refused": lambda: sentence("it has 3 of 4 bytes: copy it again"),
    "traceback": lambda: 1 / 0,
    "two lines": lambda: sentence("a\\nb"),
    "no words": lambda: sentence(""),
    "endless words": lambda: sentence("x" * 5000),
    "busy": lambda: any(iter(int, 1)),
    "blocked": lambda: time.sleep(1000),
    "large": lambda: keep([bytes(10**6) + b"x" for _ in range(1000)]),
    "large for a moment": lambda: len(bytes(3 * 10**8) + b"x"),
    "signal": lambda: os.kill(os.getpid(), 11),
    "exit": lambda: os._exit(3),
}

def sentence(words):
    raise ValueError(words)

def keep(what):
    time.sleep(5)

class Planted:
    errors = (ValueError,)
    def __init__(self, folder):
        pass
    def original(self, folder):
        (folder / "act").write_text("good")
    def mutate(self, rng, folder):
        act = list(ACTS)[int(folder.name) % len(ACTS)]
        (folder / "act").write_text(act)
        return act
    def read(self, folder):
        ACTS[(folder / "act").read_text()]()

found = watch.run(Planted, "planted", 1, Path(sys.argv[1]), 100, most=len(ACTS))
kept = {Path(place).joinpath("act").read_text(): fault
        for fault, all_kept in found.kept.items() for place, _, _ in all_kept}
print(json.dumps([found.accepted, found.refused, kept]))
"""


def test_every_sort_of_fault_is_seen_and_kept(tmp_path):
    command = [sys.executable, "-c", PLANTED, tmp_path]
    done = subprocess.run(command, cwd=BENCHMARKS, capture_output=True, text=True, check=True)
    accepted, refused, kept = json.loads(done.stdout)
    assert (accepted, refused) == (1, 1)
    assert kept == {
        "traceback": "ZeroDivisionError elsewhere",
        "two lines": "unprintable sentence: ValueError elsewhere",
        "no words": "empty sentence: ValueError elsewhere",
        "endless words": "long sentence: ValueError elsewhere",
        "busy": "more than 0 s elsewhere",
        "blocked": "blocked elsewhere",
        "large": "more than 100 MB elsewhere",
        "large for a moment": kept["large for a moment"],
        "signal": "signal 11 elsewhere",
        "exit": "exit 3 elsewhere",
    }
    assert "100 MB" in kept["large for a moment"]
    assert not list(tmp_path.glob("*worker*")), "nothing but what was kept is left"


def test_a_mutant_is_made_of_its_seed_kind_and_number(fuzzing, tmp_path):
    datasets, watch = fuzzing("datasets"), fuzzing("watch")
    (tmp_path / "bases").mkdir()
    kind, contents = datasets.Transforms(tmp_path / "bases"), []
    for name in "ab":
        folder = tmp_path / name
        folder.mkdir()
        kind.mutate(watch.random_of(7, "transforms", 12), folder)
        files = sorted(p for p in folder.rglob("*") if p.is_file())
        contents.append([(p.relative_to(folder), p.read_bytes()) for p in files])
    assert contents[0] == contents[1]


def test_damage_knows_where_counts_and_parts_are(fuzzing):
    damage, colmap = fuzzing("damage"), fuzzing("colmap")
    whole, rng = colmap.binary_files()["points3D.bin"], np.random.default_rng()
    lengths, counts = set(), set()
    for _ in range(300):
        data, what = damage.with_structure(rng, whole, b"other")
        lengths.add(len(data))
        counts |= {data[:8]} if what.startswith("count at 0 ") else set()
    assert len(counts) > 2, "the number of points was exchanged"
    assert {*whole.parts} & lengths, "it was cut where a part begins"


def test_faults_of_before_are_found_when_they_are_put_back():
    """Each within some mutants of a fixed seed; and the same mutants have no fault without it."""
    command = [sys.executable, "fuzz_inputs.py", "--put-back", "--seconds", "60"]
    done = subprocess.run(command, cwd=BENCHMARKS, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
