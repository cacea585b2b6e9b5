"""How commands end: exit codes, errors in one sentence, several processes."""

import importlib
import os
import signal
import subprocess
import sys
import time
import weakref

import pytest

from deformrf.commands import evaluate, running, train
from deformrf.commands.running import INPUT_ERROR, INTERRUPTED, run
from deformrf.core.base.paths import DEFAULT_MODEL
from deformrf.core.training import DatasetError


def test_ctrl_c_exits_with_130_and_says_so(capsys):
    def interrupted():
        raise KeyboardInterrupt

    assert run("deformrf-x", lambda: interrupted) == 130
    assert capsys.readouterr().err == "deformrf-x: interrupted\n"


class Last:
    """Sends a signal to its own process while it is deleted, as a user may at any time."""

    def __init__(self, number):
        self.number = number

    def __del__(self):
        interrupt(self.number)


def interrupt(number):
    signal.raise_signal(number)
    for _ in range(1000):  # Python handles it within these
        pass


@pytest.mark.skipif(os.name != "posix", reason="signals of one's own")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("finalizer", ["del", "callback"])
def test_no_interrupt_is_lost_in_a_finalizer(capsys, number, finalizer):
    """Warp frees its arrays in one; Python prints what it raises, and goes on."""
    hook = sys.unraisablehook

    def job():
        if finalizer == "del":
            Last(number)
        else:
            thing = {1}
            kept = weakref.ref(thing, lambda _: interrupt(number))
            del thing
            assert kept() is None
        time.sleep(20)  # which the interrupt ends
        return 0

    before = time.monotonic()
    assert run("deformrf-x", lambda: job) == INTERRUPTED
    assert time.monotonic() - before < 10
    assert capsys.readouterr().err == "deformrf-x: interrupted\n"
    assert sys.unraisablehook is hook


@pytest.mark.skipif(os.name != "posix", reason="signals of one's own")
def test_what_runs_in_the_background_keeps_its_signal():
    """A shell has SIGINT ignored there, so SIGTERM comes again as SIGTERM."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)

    def job():
        Last(signal.SIGTERM)
        time.sleep(20)
        return 0

    try:
        assert run("deformrf-x", lambda: job) == INTERRUPTED
        assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.skipif(os.name != "posix", reason="signals of one's own")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_waits_while_a_package_is_imported(number, tmp_path, monkeypatch):
    """What was imported halfway could not be imported again."""
    name = f"package_{int(number)}"
    (tmp_path / f"{name}.py").write_text(
        f"import signal\nsignal.raise_signal({int(number)})\nIS_WHOLE = True\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    before = signal.signal(number, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            with running.interrupts_waiting():
                importlib.import_module(name)
        assert signal.getsignal(number) == signal.default_int_handler
    finally:
        signal.signal(number, before)
    assert sys.modules.pop(name).IS_WHOLE


def test_what_has_to_be_done_is_done_before_an_interrupt_is_raised():
    done = []
    with pytest.raises(KeyboardInterrupt):
        with running.interrupts_waiting():
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)
            done.append("kept")
    assert done == ["kept"]
    assert signal.getsignal(signal.SIGINT) == signal.default_int_handler


def test_an_interrupt_that_is_owed_at_the_end_is_that_of_the_work():
    def job():
        Last(signal.SIGINT)
        return 0

    assert run("deformrf-x", lambda: job) == INTERRUPTED
    time.sleep(3 * running.AGAIN_SECONDS)  # and none comes later


def test_other_errors_of_a_finalizer_are_still_printed(monkeypatch):
    seen = []
    monkeypatch.setattr(sys, "unraisablehook", seen.append)

    class Wrong:
        def __del__(self):
            raise ValueError("wrong")

    def job():
        Wrong()
        return 0

    assert run("deformrf-x", lambda: job) == 0
    assert [one.exc_type for one in seen] == [ValueError]


def test_of_several_processes_only_the_first_prints(capsys, monkeypatch):
    """torchrun ends the others when it is gone."""

    def mistaken():
        raise DatasetError("no data")

    def interrupted(seconds=0.0):
        raise KeyboardInterrupt

    monkeypatch.setattr("time.sleep", interrupted)
    for rank, sentences in (("0", ["no data", "interrupted"]), ("1", [])):
        monkeypatch.setenv("RANK", rank)
        codes = [run("x", prepare) for prepare in (mistaken, interrupted)]
        assert codes == [INPUT_ERROR, INTERRUPTED]
        assert capsys.readouterr().err == "".join(f"x: {sentence}\n" for sentence in sentences)


def test_a_process_reports_an_error_that_the_first_one_does_not_have(capsys, monkeypatch):
    """Such as more processes than GPUs, or too little memory in one of them."""

    def job():
        raise MemoryError("the GPU of worker 1 has too little memory")

    monkeypatch.setenv("RANK", "1")
    monkeypatch.setattr(running, "FIRST_SECONDS", 0.0)
    assert run("x", lambda: job) == INPUT_ERROR
    assert capsys.readouterr().err == "x: the GPU of worker 1 has too little memory\n"


def test_a_fault_of_the_program_keeps_its_traceback():
    def job():
        raise ValueError("a bug")

    with pytest.raises(ValueError, match="a bug"):
        run("deformrf-x", lambda: job)


@pytest.mark.parametrize("command", [train.main, evaluate.main])
def test_help_lists_every_flag(call, command):
    result = call(command, "--help")
    assert result.code == 0
    for flag in ("--device", "--image-size"):
        assert flag in result.out


@pytest.mark.parametrize(
    "package, extra, module, arguments",
    [
        ("torch", "train", "commands.train", [".", "-o", "m.npz"]),
        ("scipy", "report", "commands.report", []),
        ("matplotlib", "report", "commands.report", []),
        ("markdown_it", "report", "commands.report", []),
        ("meshio", "exchange", "commands.rig", ["export", DEFAULT_MODEL, "-o", "m.vtu"]),
        ("pxr", "exchange", "commands.rig", ["export", DEFAULT_MODEL, "-o", "m.usda"]),
    ],
)
def test_a_command_says_which_extra_it_lacks(package, extra, module, arguments, tmp_path):
    """In a process of its own, as after an installation for viewing alone."""
    program = (
        "import sys\n"
        "class Without:\n"
        "    def find_spec(self, name, *_):\n"
        f"        if name == {package!r}:\n"
        "            raise ModuleNotFoundError(name=name)\n"
        "sys.meta_path.insert(0, Without())\n"
        f"from deformrf.{module} import main; sys.exit(main())"
    )
    command = [sys.executable, "-c", program, *map(str, arguments)]
    run = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert (run.returncode, run.stdout) == (INPUT_ERROR, "")
    assert run.stderr.count("\n") == 1
    assert f"{package}, which " in run.stderr
    assert f' is not installed: pip install ".[{extra}]" in the clone, or pip ' in run.stderr
    assert run.stderr.endswith(f'.whl[{extra}]"\n')


def test_a_missing_module_of_the_program_itself_keeps_its_traceback():
    def prepare():
        import deformrf.core.no_such_module  # noqa: F401

    with pytest.raises(ModuleNotFoundError):
        run("deformrf-x", prepare)


@pytest.mark.parametrize(
    "message",
    [
        "Failed to allocate 64 bytes on device 'cuda:0'",
        "[enforce fail at alloc_cpu.cpp:121] DefaultCPUAllocator: can't allocate memory",
    ],
)
def test_too_little_memory_of_a_device_ends_in_one_sentence(capsys, message):
    """Such as of a GPU that renders the views of deformrf eval."""

    def job():
        raise RuntimeError(message)

    assert run("deformrf-x", lambda: job) == INPUT_ERROR
    said = f"deformrf-x: the device's memory is too small ({message[:40]}"
    assert capsys.readouterr().err.startswith(said)
