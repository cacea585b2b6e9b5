"""The command `deformrf`: its list of commands, words before and behind a name, unknown names."""

import subprocess
import sys

import pytest

from deformrf.commands import entry
from deformrf.commands.dispatch import chosen
from deformrf.core.base.paths import program_version

AROUND = "what it is", "examples"


def choose(*words, opener=None):
    return chosen("deformrf", list(words), entry.COMMANDS, AROUND, opener)


@pytest.fixture
def deformrf(monkeypatch, capsys):
    """Run the command in this process; exit code, stdout and stderr."""

    def deformrf(*words):
        monkeypatch.setattr(sys, "argv", ["deformrf", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            sys.exit(entry.main())
        return ended.value.code, *capsys.readouterr()

    return deformrf


def test_words_may_stand_before_the_command_or_behind_it():
    assert choose("view", "a.npz", "--verbose") == ("view", ["a.npz", "--verbose"])
    assert choose("--verbose", "--device", "cpu", "view", "a") == (
        *("view", ["--verbose", "--device", "cpu", "a"]),
    )
    assert choose("--device=cpu", "rig", "info") == ("rig", ["--device=cpu", "info"])
    assert choose("help", "train") == ("train", ["--help"])


def test_a_path_in_place_of_a_command_is_shown(tmp_path):
    folder = str(tmp_path)
    assert choose("a.npz", "--fps", "9", opener="view") == ("view", ["a.npz", "--fps", "9"])
    assert choose("--device", "cpu", folder, opener="view") == ("view", ["--device", "cpu", folder])


@pytest.mark.parametrize("words, code", [([], 1), (["--help"], 0), (["-h"], 0), (["help"], 0)])
def test_the_list_has_each_command_and_three_examples(deformrf, words, code):
    ended, out, err = deformrf(*words)
    assert (ended, err) == (code, "")
    for name, (_, what) in entry.COMMANDS.items():
        assert f"  {name} " in out and what in out
    assert sum(line.startswith("  deformrf ") for line in out.splitlines()) == 3
    assert max(map(len, out.splitlines())) <= 100


def test_the_list_is_shown_without_anything_slow():
    """.03 s on an idle machine; numpy alone takes longer."""
    program = (
        "import sys; sys.argv[1:] = ['--help']; from deformrf.commands.entry import main\n"
        "try: main()\n"
        "finally: print(*{'numpy', 'argparse', 'logging'} & {*sys.modules}, file=sys.stderr)"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (run.returncode, run.stderr.strip()) == (0, "")


@pytest.mark.parametrize(
    "words, sentence",
    [
        (["veiw"], "there is no command 'veiw'; did you mean view?"),
        (["quux"], "there is no command 'quux'; deformrf --help lists the commands"),
        (["--size", "9x9", "view"], "--size belongs behind a command, as in deformrf view --size"),
        (["rig", "exprt"], "there is no command 'exprt'; did you mean export?"),
        (
            ["edit", "a.npz"],
            "arguments are required: -o/--output; deformrf edit --help lists",
        ),
        (["view", "a.npz", "b.npz"], "'b.npz' is one too many"),
        (["view", "--framez", "3"], "there is no option --framez (did you mean --frames?)"),
        (["view", "--fps", "many"], "--fps: 'many' is no whole number"),
        (["train", "a", "-o", "b.npz", "--aabb", "1", "2"], "--aabb: expected 6 arguments"),
        (["eval", "a", "b", "--device", "gpu"], "--device: invalid choice: 'gpu'"),
    ],
)
def test_a_mistake_ends_in_one_sentence(deformrf, words, sentence):
    code, out, err = deformrf(*words)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err.startswith("deformrf") and sentence in err


@pytest.mark.parametrize("words", [["--version"], ["view", "--version"], ["--version", "rig"]])
def test_the_version_is_printed_wherever_it_is_asked_for(deformrf, words):
    assert deformrf(*words) == (0, f"deformrf {program_version()}\n", "")


def test_a_mistake_runs_nothing_of_the_current_folder(tmp_path):
    (tmp_path / "difflib.py").write_text("raise SystemExit('this is the folder')")
    program = "import sys; from deformrf.commands.entry import main; sys.exit(main())"
    command = [sys.executable, "-c", program, "veiw"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2 and "did you mean view?" in done.stderr
