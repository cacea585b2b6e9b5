"""Tests that need a window are skipped without one, and fail where somebody relies on them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
WINDOW_TEST = "tests/test_window.py::test_the_window_closes_as_the_window_manager_asks"
CONTEXT_TEST = "tests/test_gui.py::test_a_click_on_a_button_is_not_the_views"


def outcome(test, required, **environment):
    """What the last line of pytest's report says of one test."""
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", test]
    environment = {**os.environ, **environment, "DEFORMRF_REQUIRE_WINDOW": required}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    return done.stdout.splitlines()[-1]


@pytest.mark.parametrize("required, word", [("", "1 skipped"), ("1", "1 error")])
def test_without_a_screen_the_window_is_skipped_unless_it_is_required(tmp_path, required, word):
    assert word in outcome(WINDOW_TEST, required, PATH=str(tmp_path))


@pytest.mark.parametrize("required, word", [("", "1 skipped"), ("1", "1 error")])
def test_without_opengl_so_are_contexts(required, word):
    lacking = {"__EGL_VENDOR_LIBRARY_FILENAMES": os.devnull}
    assert word in outcome(CONTEXT_TEST, required, **lacking)


def test_ci_requires_the_window():
    assert "\nexport DEFORMRF_REQUIRE_WINDOW=1" in (ROOT / ".ci" / "run").read_text()
