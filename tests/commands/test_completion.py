"""deformrf completion: bash completes words by the script that it prints."""

import shutil
import subprocess
import sys

import pytest

from deformrf.commands import completion

BASH = shutil.which("bash")
ASK = """
source "$1"; shift
complete -p deformrf || exit 1
COMP_WORDS=("$@") COMP_CWORD=$(($# - 1))
_deformrf
echo "${COMPREPLY[@]}"
"""


@pytest.fixture(scope="module")
def script(tmp_path_factory):
    program = "import sys; from deformrf.commands.entry import main; sys.exit(main())"
    command = [sys.executable, "-c", program, "completion", "bash"]
    path = tmp_path_factory.mktemp("completion") / "deformrf.bash"
    path.write_text(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    return path


@pytest.mark.skipif(BASH is None, reason="needs bash")
@pytest.mark.parametrize(
    "words, completed",
    [
        ("re", "render report"),
        ("rig e", "export"),
        ("--device cpu rig bind a.npz --we", "--weights"),
        ("rig bind a.npz --weights h", "harmonic"),
        ("train DATA --preset t", "tiny"),
        ("view --mode de", "depth"),
        ("view --sc", "--screenshot"),
        ("report --device c", "cpu cuda"),
        ("view mod", ""),  # files, by bash itself
        ("completion z", "zsh"),
    ],
)
def test_bash_completes(script, words, completed):
    command = [BASH, "-c", ASK, "bash", script, "deformrf", *words.split()]
    run = subprocess.run(command, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    registered, found = run.stdout.splitlines()
    assert registered == "complete -o default -F _deformrf deformrf"
    assert found == completed


def test_zsh_has_the_same_through_its_module(capsys):
    assert completion.main(["zsh"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("autoload -U +X bashcompinit && bashcompinit\n")
    assert said.endswith(completion.script() + "\n")
