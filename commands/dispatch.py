"""The word of a command line that names a command, and what may stand before it.

Nothing slow is imported here: the list of commands is shown at once.
"""

import os
import sys

HELP, VERSION, VERBOSE, DEVICE = ("-h", "--help"), "--version", "--verbose", "--device"
INPUT_ERROR = 2


def chosen(program: str, words: list[str], commands: dict, around: tuple[str, str], opener=None):
    """The name of the command, and the words for it: those around the name.

    Args:
        commands: By name, pairs of which the second says what the command does.
        around: Text before and behind the list of commands.
        opener: The command for a path in place of a name.

    Raises:
        SystemExit: The list was asked for and is printed, or no command has that name; with its
            exit code.
    """
    before, behind = [], list(words)
    while behind and behind[0].partition("=")[0] in (DEVICE, VERSION, VERBOSE):
        count = 2 if behind[0] == DEVICE else 1
        before, behind = before + behind[:count], behind[count:]
    name, behind = (behind[0], behind[1:]) if behind else ("", [])
    if name == "help" and behind:
        name, behind = behind[0], [*behind[1:], "--help"]
    if name in commands:
        return name, before + behind
    if VERSION in before and opener:
        return opener, before
    if opener and not name.startswith("-") and (os.path.splitext(name)[1] or os.path.exists(name)):
        return opener, [*before, name, *behind]
    if name in ("", "help", *HELP):
        width = max(map(len, commands))
        rows = [f"  {name:{width}}  {what}" for name, (_, what) in commands.items()]
        print("\n".join([around[0], "", *rows, "", around[1]]).rstrip())
        raise SystemExit(0 if name else 1)
    print(f"{program}: {_unknown(program, name, commands)}", file=sys.stderr)
    raise SystemExit(INPUT_ERROR)


def _unknown(program, name, commands) -> str:
    if name.startswith("-"):
        return f"{name} belongs behind a command, as in {program} {next(iter(commands))} {name}"
    from difflib import get_close_matches

    near = get_close_matches(name, commands, 1)
    meant = f"did you mean {near[0]}?" if near else f"{program} --help lists the commands"
    return f"there is no command {name!r}; {meant}"
