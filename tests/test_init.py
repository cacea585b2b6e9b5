"""`import deformrf` loads nothing before a name is used, and programs print nothing of ours."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import deformrf

ROOT = Path(__file__).resolve().parent.parent


def run(program, *arguments, **options):
    done = subprocess.run(
        [sys.executable, "-c", program, *map(str, arguments)],
        **{"capture_output": True, "text": True, **options},
    )
    assert done.returncode == 0, done.stderr
    return done


def test_the_import_loads_no_other_module():
    """A command forgets the current folder first, which may have a numpy.py."""
    program = "import sys; old = {*sys.modules}; import deformrf; print(*{*sys.modules} - old)"
    assert run(program).stdout.split() == ["deformrf"]


def test_the_names_are_those_of_the_stub():
    stub = (ROOT / "__init__.pyi").read_text(encoding="utf-8")
    assert sorted(re.findall(r" as (\w+)", stub)) == deformrf.__all__
    for name in (*deformrf.__all__, "__version__"):
        assert getattr(deformrf, name) is getattr(deformrf, name) and name in dir(deformrf)
    homes = re.findall(r"from \.([\w.]+) import", stub)
    assert {f"deformrf.{home}" for home in homes} <= {*sys.modules}


def test_a_wrong_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="'deformrf' has no attribute 'laod'"):
        deformrf.laod  # noqa: B018
    with pytest.raises(ImportError, match="laod"):
        exec("from deformrf import laod")  # test_layout.py refuses it in a file


PROGRAM = """
import sys
import deformrf

model = deformrf.load(sys.argv[1])
solver = model.solver()
solver.grab([int(solver.rest_vertices[:, 2].argmax())])
solver.step(1 / 60)
model.set_vertices(solver.vertices)
model.render(model.camera(width=32, height=24)).save("picture.png")
model.save("copy.npz")
"""


def test_a_program_prints_nothing_of_its_own(ball_file, tmp_path):
    """Warp would greet, and name each module of kernels that it loads."""
    done = run(PROGRAM, ball_file, cwd=tmp_path)
    assert (done.stdout, done.stderr) == ("", "")
    assert (tmp_path / "picture.png").stat().st_size and (tmp_path / "copy.npz").stat().st_size


SKINNER = """
import numpy as np
from deformrf.wings.rig import Skinner

print(Skinner(np.zeros((3, 3)), np.ones((3, 1)), "cpu").pose(np.eye(4)[None]).numpy().sum())
"""


def test_posing_by_bones_prints_nothing_either():
    done = run(SKINNER)
    assert (done.stdout, done.stderr) == ("0.0\n", "")
