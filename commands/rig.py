"""deformrf rig: skeletons, weights and clips of models.

Each subcommand is a dataclass of arguments with a function that prepares its work: those of
rigs themselves are in rig_bind.py and rig_quality.py, those of files of other programs in
rig_files.py.
"""

from ..core.base.device import start_warp
from .options import parsed_one
from .rig_bind import BindArguments, InfoArguments, prepare_bind, prepare_info
from .rig_files import (
    CheckArguments,
    ExportArguments,
    ImportArguments,
    prepare_check,
    prepare_export,
    prepare_import,
)
from .rig_quality import QualityArguments, prepare_quality
from .running import run

PROGRAM = "deformrf rig"
COMMANDS = {  # subcommand: its arguments, and what prepares it
    "bind": (BindArguments, prepare_bind),
    "info": (InfoArguments, prepare_info),
    "quality": (QualityArguments, prepare_quality),
    "export": (ExportArguments, prepare_export),
    "check": (CheckArguments, prepare_check),
    "import": (ImportArguments, prepare_import),
}


def main() -> int:
    program, arguments, prepare = parsed_one(
        PROGRAM, "Rigs of models: bones, weights, clips.", COMMANDS
    )

    def start():
        start_warp()
        return prepare(arguments)

    return run(program, start)
