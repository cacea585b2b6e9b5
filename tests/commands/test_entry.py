"""Ctrl-C at a command's start: one line, exit code 130."""

import os
import signal
import subprocess
import sys
import tomllib

import pytest

from deformrf.commands import entry
from deformrf.core.base.paths import ROOT, program_version

PROGRAM = """
import importlib, os, signal, sys

package, function, *arguments = sys.argv[1:]
class Interrupt:
    def find_spec(self, name, *_):
        if name == package:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupt())
sys.argv = ["x", *arguments]
module, _, name = function.partition(":")
sys.exit(getattr(importlib.import_module(module), name)())
"""
SCRIPTS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]


NAMES = {"deformrf": "deformrf view"} | {
    program: program.replace("-", " ") for program in SCRIPTS if "-" in program
}


@pytest.mark.parametrize("program", SCRIPTS)
@pytest.mark.parametrize("package", ["dataclasses", "argparse"])
def test_an_interrupt_of_the_imports_is_one_line(program, package):
    words = ["view"] if program == "deformrf" else []
    command = [sys.executable, "-c", PROGRAM, package, SCRIPTS[program], *words]
    run = subprocess.run(command, capture_output=True, text=True)
    assert (run.returncode, run.stdout) == (130, "")
    assert run.stderr == f"{NAMES[program]}: interrupted\n"


def test_an_interrupt_waits_until_torch_is_imported(data, tmp_path):
    """It can't be imported again after an import that was ended halfway."""
    arguments = [str(data), "-o", str(tmp_path / "m.npz"), "--preset", "tiny", "--device", "cpu"]
    arguments += ["--scene-radius", "1.3"]
    command = [sys.executable, "-c", PROGRAM, "torch.optim.adam", SCRIPTS["deformrf"], "train"]
    run = subprocess.run([*command, *arguments], capture_output=True, text=True)
    assert (run.returncode, run.stderr) == (130, "deformrf train: interrupted\n")


def test_every_command_begins_here():
    older = {f"deformrf-{name}" for name in entry.COMMANDS}
    assert {"deformrf"} <= SCRIPTS.keys() <= {"deformrf", *older} and len(SCRIPTS) == 8
    assert all(target.startswith("deformrf.commands.entry:") for target in SCRIPTS.values())


@pytest.mark.parametrize("name", entry.COMMANDS)
def test_every_command_says_its_version(name, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", [name, "--version"])
    assert entry.begin(name) == 0
    assert capsys.readouterr().out == f"deformrf {program_version()}\n"


@pytest.mark.parametrize("program", SCRIPTS)
def test_an_older_name_is_the_same_command(program):
    target = SCRIPTS[program].partition(":")[2]
    code = f"from deformrf.commands.entry import {target}; import sys; sys.exit({target}())"
    words = ["view", "-h"] if program == "deformrf" else ["-h"]
    run = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True)
    assert (run.returncode, run.stderr) == (0, "")
    assert run.stdout.startswith(f"usage: {NAMES[program]} ")


FAULT = """
import sys
from deformrf.commands import entry, view

def broken(chosen):
    from deformrf.viewer.events import EventLog

    EventLog(False)("grab", secret="contents")
    open("{folder}/private/name.npz")

def job(chosen):
    return lambda: broken(chosen)

view.prepare = job
sys.argv = ["x", *{arguments}]
sys.exit(entry.view())
"""


@pytest.mark.parametrize("arguments", [[], ["--verbose"]])
def test_a_fault_leaves_a_report_that_can_be_passed_on(tmp_path, arguments):
    program = FAULT.format(folder=tmp_path, arguments=arguments)
    state = {**os.environ, "XDG_STATE_HOME": str(tmp_path / "state")}
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=state)
    assert run.returncode == 1 and "Traceback" in run.stderr
    assert ("deformrf view: grab\n" in run.stderr) == bool(arguments)
    (report,) = (tmp_path / "state").rglob("crash-*.txt")
    assert str(report) in run.stderr
    text = report.read_text()
    for expected in ("numpy 2", "FileNotFoundError", "deformrf.viewer.events: grab", "name.npz"):
        assert expected in text, text
    assert str(tmp_path) not in text and "contents" not in text


def test_a_mistake_of_the_user_leaves_none(tmp_path):
    program = "from deformrf.commands.entry import view; import sys; sys.exit(view())"
    state = {**os.environ, "XDG_STATE_HOME": str(tmp_path)}
    command = [sys.executable, "-c", program, "nothing.npz", "--headless", "--screenshot", "a.png"]
    run = subprocess.run(command, capture_output=True, text=True, env=state, cwd=tmp_path)
    assert run.returncode == 2 and run.stderr.count("\n") == 1
    assert not list(tmp_path.rglob("crash-*"))


def test_garbage_is_collected_after_the_start_and_not_at_the_end():
    said = (
        "import atexit, gc, sys\n"
        "atexit.register(lambda: print(gc.isenabled(), gc.get_freeze_count() > 10_000))\n"
        "from deformrf.commands.entry import begin\n"
        "sys.argv = ['x', '--help']\n"
        "sys.exit(begin('view'))\n"
    )
    run = subprocess.run([sys.executable, "-c", said], capture_output=True, text=True, check=True)
    assert run.stdout.split("\n")[-2:] == ["True True", ""]


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_after_the_commands_end_shows_no_traceback(name, tmp_path):
    """It comes while Python itself ends."""
    program = f"""
import contextlib, signal, sys
from deformrf.commands.entry import begin
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.argv = ["deformrf", "missing.npz", "-o", "smaller.npz"]
with contextlib.suppress(SystemExit):
    begin("edit")
signal.raise_signal(signal.{name})
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, cwd=tmp_path
    )
    assert done.returncode == -getattr(signal, name) and "Traceback" not in done.stderr
    assert "missing.npz" in done.stderr
