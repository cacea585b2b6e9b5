"""Processes that the program starts run nothing of the current folder, however it was started."""

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from captures import circle, write_capture

from deformrf.core.base import children

ROOT = Path(children.ROOT)
PLANTED = (
    "numpy PIL warp torch scipy pycolmap av rich platformdirs lazy_loader pyglet moderngl "
    "imgui_bundle json re tempfile subprocess signal enum random dataclasses typing pathlib "
    "sitecustomize usercustomize encodings"
).split()
STARTERS = {"Popen", "run", "call", "check_call", "check_output", "getoutput", "getstatusoutput"}
OF_OS = ("system", "popen", "exec", "spawn", "posix_spawn", "fork", "startfile")
OTHERS = {"multiprocessing", "pty", "asyncio", "webbrowser", "runpy", "pexpect", "sh"}
WHERE = """
import sys
from deformrf.core.base.children import start
code = "import sys, numpy, PIL, json, deformrf.core.base.streams as s; print(s.__file__, *sys.path)"
with start(code, stdout=-1, stderr=-2, text=True) as process:
    print(process.communicate()[0], "--", process.args)
"""


def plant(folder, names):
    """Modules that note that they were run."""
    for name in names:
        note = f"open({str(folder / 'EXECUTED')!r}, 'a').write({name + ' '!r})\n"
        (folder / f"{name}.py").write_text(note + "raise SystemExit('EXECUTED')\n")


def executed(folder):
    path = folder / "EXECUTED"
    return path.read_text() if path.exists() else ""


@pytest.fixture
def trap(tmp_path):
    """A folder that somebody else filled."""
    folder = tmp_path / "downloaded"
    folder.mkdir()
    plant(folder, [*PLANTED, "deformrf"])
    return folder


@pytest.fixture
def script(tmp_path):
    """A function that writes a console script: it lies in a folder of its own."""

    def write(code):
        path = tmp_path / "bin" / "program"
        path.parent.mkdir(exist_ok=True)
        path.write_text(code)
        return path

    return write


def run(folder, *command, **variables):
    """A Python in a folder, which finds this package by a PYTHONPATH, unless it gets another."""
    known = {"PYTHONPATH": str(ROOT.parent), "PYTHONDONTWRITEBYTECODE": "1"}
    variables = {**os.environ, **known, **variables}
    command = [sys.executable, *map(str, command)]
    return subprocess.run(command, cwd=folder, env=variables, capture_output=True, text=True)


def starts_of(path):
    """Calls in a source that start a process, as (line, words)."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = []
        if isinstance(node, ast.Import):
            names = [(alias.name, alias.asname) for alias in node.names]
            if any(name.partition(".")[0] in OTHERS for name, _ in names):
                yield node.lineno, "import"
            if any(alias for name, alias in names if name in ("subprocess", "os")):
                yield node.lineno, "another name"
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            module, names = node.module.partition(".")[0], [alias.name for alias in node.names]
            bad = module in OTHERS or (module == "subprocess" and STARTERS & set(names))
            if bad or (module == "os" and any(name.startswith(OF_OS) for name in names)):
                yield node.lineno, f"from {module}"
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            module = node.value.id
            called = module == "subprocess" and node.attr in STARTERS
            if called or (module == "os" and node.attr.startswith(OF_OS)):
                yield node.lineno, f"{module}.{node.attr}"


def test_one_function_starts_all_processes():
    """But for the masking program that the command line names."""
    sources = [
        p
        for folder in ("core", "wings", "commands", "viewer")
        for p in (ROOT / folder).rglob("*.py")
    ]
    assert len(sources) > 200
    found = {
        (path.relative_to(ROOT).as_posix(), words)
        for path in sources
        for _, words in starts_of(path)
        if words != "subprocess.Popen" or not is_annotation(path)
    }
    places = "core/base/children.py", "wings/capture/masking.py"
    assert found == {(place, "subprocess.Popen") for place in places}


def is_annotation(path):
    """Whether a source names Popen as a type alone."""
    text = path.read_text(encoding="utf-8")
    return "subprocess.Popen(" not in text and "subprocess.Popen | None" in text


@pytest.mark.parametrize(
    "code",
    [
        "import subprocess\nsubprocess.run([])",
        "import subprocess as s",
        "from subprocess import Popen",
        "import multiprocessing.pool",
        "import os\nos.system('')",
        "import os\nos.posix_spawnp('')",
        "from os import execv",
        "from webbrowser import open",
    ],
)
def test_what_starts_a_process_is_seen(tmp_path, code):
    (tmp_path / "a.py").write_text(code)
    assert list(starts_of(tmp_path / "a.py"))


@pytest.mark.parametrize("more", ["", os.pathsep, f"{os.pathsep}.", f"{os.pathsep}./"])
def test_a_child_imports_what_its_parent_does(trap, script, more):
    """Of a script; where PYTHONPATH has an empty entry or a dot, it is as for any Python."""
    for path in trap.glob("*.py") if more else ():
        if path.stem not in ("numpy", "PIL"):
            path.unlink()  # Python runs these itself before any line of ours
    command = [script(WHERE)]
    done = run(trap, *command, PYTHONPATH=f"{ROOT.parent}{more}")
    assert done.returncode == 0 and not executed(trap), done.stderr
    where, *path = done.stdout.partition(" -- ")[0].split()
    assert where == str(ROOT / "core" / "base" / "streams.py") and str(trap) not in path, (
        done.stdout
    )


def test_a_child_of_python_c_imports_nothing_of_the_current_folder(trap, tmp_path):
    """The parent does as Python does, and begins elsewhere."""
    begun = "import os, subprocess; from deformrf.core.base import children; "
    code = f"{begun} os.chdir({str(trap)!r})\n{WHERE}"
    done = run(tmp_path, "-c", code)
    assert done.returncode == 0 and not executed(trap), done.stderr
    assert done.stdout.split()[0] == str(ROOT / "core" / "base" / "streams.py")


MODULE = """
import subprocess, sys
import deformrf.core.base.children
from pathlib import Path
for name in {planted!r}:  # now, or `python -m` would run them before any line of ours
    Path(name + ".py").write_text("open('EXECUTED', 'a').write('x'); raise SystemExit")
"""


def test_a_child_of_python_m_imports_nothing_of_the_current_folder(tmp_path):
    begun, left = tmp_path / "begun", tmp_path / "left"
    for folder in (begun, left):
        folder.mkdir()
        names = [*PLANTED, "deformrf"]
        leave = "" if folder == begun else f"import os; os.chdir({str(tmp_path)!r})\n"
        (folder / "tool.py").write_text(MODULE.format(planted=names) + leave + WHERE)
        done = run(folder, "-m", "tool")
        assert done.returncode == 0 and not executed(folder), done.stdout + done.stderr
        where, *path = done.stdout.partition(" -- ")[0].split()
        assert where == str(ROOT / "core" / "base" / "streams.py") and str(folder) not in path


def test_a_folder_that_a_user_names_by_its_whole_path_is_kept(tmp_path, script):
    """Packages may be installed there, and the user may be in it."""
    libraries = tmp_path / "libraries"
    libraries.mkdir()
    (libraries / "installed.py").write_text("print('installed')")
    command = [script(WHERE.replace("import sys, numpy", "import installed, sys, numpy"))]
    path = os.pathsep.join([str(ROOT.parent), str(libraries)])
    for folder in (tmp_path, libraries):
        done = run(folder, *command, PYTHONPATH=path)
        assert done.stdout.startswith("installed\n"), done.stdout
    done = run(libraries, *command, PYTHONPATH=f"{ROOT.parent}{os.pathsep}.")
    assert "No module named 'installed'" in done.stdout


def test_a_package_that_lies_in_the_current_folder_is_the_child_s_as_well(tmp_path):
    """As in a checkout's folder: `python -m deformrf.viewer` finds it there alone."""
    (tmp_path / "deformrf").symlink_to(ROOT)
    command = WHERE + "import deformrf.core.base.children as c; c.forget_current_folder()\n"
    command += "import sys, deformrf.viewer; print(deformrf.viewer.__file__, '' in sys.path)"
    done = run(tmp_path, "-c", command, PYTHONPATH="")
    assert done.returncode == 0, done.stderr
    first, *_, last = done.stdout.splitlines()
    there = tmp_path / "deformrf"
    assert first.split()[0] == str(there / "core" / "base" / "streams.py")
    assert last == f"{there / 'viewer' / '__init__.py'} False"


def test_in_the_folder_where_python_s_packages_are_all_is_found(tmp_path):
    import numpy

    packages = Path(numpy.__file__).parents[1]
    done = run(packages, "-m", "deformrf.viewer", "--help")
    assert done.returncode == 0, done.stderr
    done = run(packages, "-c", WHERE)
    assert done.stdout.split()[0] == str(ROOT / "core" / "base" / "streams.py"), done.stdout


def test_a_folder_whose_name_has_a_separator_is_no_two_folders(tmp_path, script):
    """Its second half would be a folder below the current one."""
    odd = tmp_path / f"a{os.pathsep}b"
    odd.mkdir()
    (tmp_path / "b").mkdir()
    plant(tmp_path / "b", ["numpy"])
    code = f"import sys; sys.path.insert(0, {str(odd)!r})\n" + WHERE
    done = run(tmp_path, script(code))
    assert done.returncode == 0 and not executed(tmp_path / "b"), done.stdout


@pytest.mark.parametrize("flags", [["--help"], ["--version"]])
def test_the_viewer_by_python_m_runs_nothing_of_the_current_folder(tmp_path, flags):
    """Apart from deformrf.py and what Python imports before its first line."""
    plant(tmp_path, PLANTED)
    done = run(tmp_path, "-m", "deformrf.viewer", *flags)
    assert done.returncode == 0 and not executed(tmp_path), done.stderr + executed(tmp_path)


def test_the_definition_by_python_m_runs_nothing_of_the_current_folder(tmp_path):
    plant(tmp_path, PLANTED)
    done = run(tmp_path, "-m", "deformrf.core.definition", "--help")
    assert done.returncode == 0 and not executed(tmp_path), done.stderr + executed(tmp_path)


def test_a_command_forgets_the_dot_of_pythonpath(tmp_path, script):
    """Where a script of Python's own has not imported anything from there."""
    plant(tmp_path, ["numpy", "PIL", "warp", "rich", "platformdirs", "lazy_loader"])
    command = script("import sys; from deformrf.commands.entry import view; sys.exit(view())")
    done = run(tmp_path, command, "--help", PYTHONPATH=f"{ROOT.parent}{os.pathsep}.")
    assert done.returncode == 0 and not executed(tmp_path), done.stderr


TRAIN = """
import sys
from deformrf.commands.entry import train
from deformrf.wings.capture import mapping
mapping.incremental = lambda *_, **named: []  # so that another process finds the cameras
sys.exit(train())
"""


def test_cameras_are_found_in_such_a_folder(trap, script, tmp_path):
    pytest.importorskip("pycolmap")
    import numpy as np

    write_capture(trap, circle(16), np.random.default_rng(7))
    done = run(trap, script(TRAIN), ".", "-o", tmp_path / "toy.npz", "--check", "--device", "cpu")
    assert "The cameras of 16 of 16 photographs were found" in done.stdout, done.stderr
    assert done.returncode == 0 and not executed(trap), done.stderr


@pytest.mark.parametrize("job", ["films.film_job", "training.train_job"])
def test_the_code_of_a_job_forgets_the_current_folder_by_itself(trap, tmp_path, job):
    """Where somebody runs it by a Python of their own, without -P."""
    begun = f"from deformrf.viewer.{job} import CODE; print(CODE)"
    code = run(tmp_path, "-c", begun).stdout
    done = run(trap, "-c", code, "snapshot.npz", "--help")
    assert done.returncode == 0 and not executed(trap), done.stderr


JOBS = """
import os, sys, time
from pathlib import Path
import numpy
from deformrf.core.field import modelfile
from deformrf.wings.lab.omissions import starts
from deformrf.viewer.films.film_job import FilmJob
from deformrf.viewer.document import Scene
from deformrf.viewer.document import save_session, start_of
from deformrf.viewer.training import TrainJob, offer_of

model, out = map(Path, sys.argv[1:])
field = modelfile.load(model)
scene = Scene(field, "ball", "cpu")
start = start_of(scene)
scene.clock.advance(0.1)
session = save_session(scene, start, out / "s.jsonl")
arguments = ["--size", "48x32", "--fps", "15", "--samples", "1", "--hide-handles"]
arguments += ["--session", str(session), "--device", "cpu", "-o", str(out / "f.mp4")]
film = FilmJob(field, "ball", arguments)
offer = offer_of(Path("."), "cpu")
training = TrainJob(offer.arguments, offer.output, "cpu")
while not (film.ended and training.ended):
    time.sleep(0.05)
print(film.written, film.problem, training.code, training.line, sep="\\n")
print(len(starts.run_python(starts.VIEWING, str(model), "cpu")))
"""


@pytest.mark.parametrize("way", ["script", pytest.param("module", marks=pytest.mark.soak)])
def test_a_film_training_and_a_report_s_starts_in_such_a_folder(
    trap, script, tmp_path, ball_file, way
):
    from PIL import Image

    for number in range(5):
        Image.new("RGB", (32, 24), (40 * number, 90, 60)).save(trap / f"{number}.jpg")
    command = [script(JOBS)]
    if way == "module":
        for path in trap.glob("*.py"):
            path.unlink()  # `python -m` would run them itself
        head, tail = JOBS.split("model, out")
        (trap / "tool.py").write_text(head + MODULE.format(planted=PLANTED) + "model, out" + tail)
        command = ["-m", "tool"]
    done = run(trap, *command, ball_file, tmp_path)
    assert not executed(trap), executed(trap)
    film, problem, code, line, count = done.stdout.splitlines()[-5:]
    assert (film, problem) == (str(tmp_path / "f.mp4"), ""), done.stdout + done.stderr
    assert code == "2" and "5 photographs, and at least 8 are needed" in line
    assert json.loads(count) == 4
