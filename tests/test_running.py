"""How commands end: exit codes, errors in one sentence, several processes."""

import pytest

from deformrf.core.commands import INPUT_ERROR, INTERRUPTED, evaluate, run, running, train
from deformrf.core.training import DatasetError


def test_ctrl_c_exits_with_130_and_says_so(capsys):
    def interrupted():
        raise KeyboardInterrupt

    assert run("deformrf-x", lambda: interrupted) == 130
    assert capsys.readouterr().err == "deformrf-x: interrupted\n"


def test_of_several_processes_the_first_one_speaks(capsys, monkeypatch):
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


def test_a_process_says_an_error_that_the_first_one_has_not(capsys, monkeypatch):
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
