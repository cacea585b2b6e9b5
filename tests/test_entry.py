"""Ctrl-C at a command's start: one line, exit code 130."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from deformrf.viewer import entry

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
SCRIPTS = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"][
    "scripts"
]


@pytest.mark.parametrize("program", SCRIPTS)
@pytest.mark.parametrize("package", ["dataclasses", "tyro"])
def test_an_interrupt_of_the_imports_is_one_line(program, package):
    command = [sys.executable, "-c", PROGRAM, package, SCRIPTS[program]]
    run = subprocess.run(command, capture_output=True, text=True)
    assert (run.returncode, run.stdout) == (130, "")
    assert run.stderr == f"{program}: interrupted\n"


def test_every_command_begins_here():
    assert SCRIPTS.keys() == entry.COMMANDS.keys()
    assert all(target.startswith("deformrf.viewer.entry:") for target in SCRIPTS.values())
