"""Benchmarks start: nothing that they import has moved."""

import importlib.util
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent / "benchmarks"


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.py")), ids=lambda path: path.stem)
def test_a_benchmark_can_be_imported(path, monkeypatch):
    # As a script has its own folder and the supports'.
    for folder in (FOLDER, FOLDER.parent / "support"):
        monkeypatch.syspath_prepend(folder)
    monkeypatch.setattr(sys, "argv", [path.name])
    spec = importlib.util.spec_from_file_location(f"benchmark_{path.stem}", path)
    try:
        spec.loader.exec_module(importlib.util.module_from_spec(spec))
    except ModuleNotFoundError as error:
        if error.name == "bpy":
            pytest.skip("Blender's module isn't installed")
        raise
