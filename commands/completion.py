"""deformrf completion: a script for bash or zsh, which completes commands, options and values."""

from dataclasses import dataclass
from importlib import import_module
from typing import Annotated, Literal

from ..core.base.arguments import Arg
from . import entry
from .options import OnCpu, options_of, parsed
from .running import run

PROGRAM = "deformrf completion"
ANYWHERE = "--device --verbose --version --help"
INDENT = "\n        "
SCRIPT = """\
_deformrf() {{
    local word=${{COMP_WORDS[COMP_CWORD]}} before=${{COMP_WORDS[COMP_CWORD-1]}}
    local command= names= options= values= i
    for ((i = 1; i < COMP_CWORD; i++)); do
        case "$command ${{COMP_WORDS[i]}}" in{commands}
        esac
    done
    case $command in{names}
    esac
    case $command in{options}
    esac
    case "$command $before" in{values}
    esac
    if [[ -n $values ]]; then
        options=$values
    elif [[ $word != -* ]]; then
        options=$names
    fi
    COMPREPLY=($(compgen -W "$options" -- "$word"))  # none: files, by -o default
}}
complete -o default -F _deformrf deformrf"""
ZSH = "autoload -U +X bashcompinit && bashcompinit\n"


@dataclass(frozen=True)
class CompletionArguments(OnCpu):
    """Print a script with which a shell completes the words of deformrf."""

    shell: Annotated[Literal["bash", "zsh"], Arg("SHELL", positional=True)]
    """bash or zsh; its start-up file runs the script: eval "$(deformrf completion bash)"."""


def main(words: list[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    chosen = parsed(PROGRAM, CompletionArguments, words)

    def prepare():
        text = script()
        return lambda: print(text if chosen.shell == "bash" else ZSH + text) or 0

    return run(PROGRAM, prepare)


def script() -> str:
    """The script, for bash and, with bashcompinit, for zsh."""
    kinds = arguments_of_all()
    below = {"": list(entry.COMMANDS)}  # what may follow a command's words
    for words in kinds:
        if " " in words:
            below.setdefault(words.partition(" ")[0], []).append(words.partition(" ")[2])
    commands = [
        f'"{above} {name}") command="{f"{above} {name}".strip()}" ;;'
        for above, names in below.items()
        for name in names
    ]
    names = [f'"{words}") names="{" ".join(names)}" ;;' for words, names in below.items()]
    options = [f'*) options="{ANYWHERE}" ;;']
    values = ['*" --device") values="auto cpu cuda" ;;']
    for words, kind in kinds.items():
        found = [one for one in options_of(kind) if one.names not in ((), ("--device",))]
        all_names = " ".join(name for one in found for name in one.names if name.startswith("--"))
        options.insert(-1, f'"{words}") options="{all_names} {ANYWHERE}" ;;')
        values += [
            f'"{words} {name}") values="{" ".join(map(str, one.choices))}" ;;'
            for one in found
            for name in one.names
            if one.choices and " " not in one.value
        ]
    values.append('"completion "*) values="bash zsh" ;;')
    blocks = {"commands": commands, "names": names, "options": options, "values": values}
    return SCRIPT.format(**{name: INDENT + INDENT.join(rows) for name, rows in blocks.items()})


def arguments_of_all() -> dict[str, type]:
    """The dataclass of each command's arguments, by the words of the command."""
    kinds = {}
    for name, (module, _) in entry.COMMANDS.items():
        members = vars(import_module(f"{__package__}.{module}"))
        if "COMMANDS" in members:
            kinds |= {f"{name} {sub}": kind for sub, (kind, _) in members["COMMANDS"].items()}
        else:
            kinds[name] = members[f"{module.capitalize()}Arguments"]
    return kinds
