"""What conftest.py decides for all tests: who needs a window, and which numbers are random."""

import os
import signal
import zlib
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.parametrize("required, outcome", [("", pytest.skip), ("1", pytest.fail)])
def test_a_test_without_a_window_is_skipped_unless_windows_are_required(
    required, outcome, give_up_window, monkeypatch
):
    monkeypatch.setenv("DEFORMRF_REQUIRE_WINDOW", required)
    with pytest.raises(outcome.Exception, match="no screen"):
        give_up_window("no screen")


@pytest.mark.parametrize("required, outcome", [("", pytest.skip), ("1", pytest.fail)])
def test_so_is_a_test_without_opengl(required, outcome, request, monkeypatch):
    from deformrf.viewer import window

    def open_window(*_, **__):
        raise window.WindowError("no OpenGL")

    monkeypatch.setattr(window, "open_window", open_window)
    monkeypatch.setenv("DEFORMRF_REQUIRE_WINDOW", required)
    with pytest.raises(outcome.Exception, match="no OpenGL"):
        request.getfixturevalue("window")


def test_files_that_begin_first_exist(pytestconfig):
    conftest = pytestconfig.pluginmanager.get_plugin(str(ROOT / "tests" / "conftest.py"))
    assert not [name for name in conftest.LONG if not (ROOT / "tests" / name).exists()]


def test_ci_requires_the_window():
    assert "\nexport DEFORMRF_REQUIRE_WINDOW=1" in (ROOT / ".ci" / "run").read_text()


def test_random_numbers_depend_on_the_seed_and_the_name_of_the_test():
    """They are the same in every session, unless DEFORMRF_TEST_SEED is set."""
    seed = int(os.environ.get("DEFORMRF_TEST_SEED", 0))
    name = b"test_random_numbers_depend_on_the_seed_and_the_name_of_the_test"
    first, second = np.random.SeedSequence([seed, zlib.crc32(name)]).spawn(2)
    for expected in (first, second):
        drawn = np.random.default_rng().integers(2**60)
        assert drawn == np.random.default_rng(expected).integers(2**60)


@pytest.mark.parametrize("turn", [1, 2])
def test_a_signal_s_handler_ends_with_the_test_that_set_it(turn):
    """The second turn fails if the first one's is left; as a command's end does, see entry.py."""
    assert signal.getsignal(signal.SIGINT) == signal.default_int_handler
    assert signal.getsignal(signal.SIGTERM) != signal.SIG_IGN
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
