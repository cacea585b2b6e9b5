"""python -m deformrf.viewer"""

import sys

from ..core.base.children import forget_current_folder

forget_current_folder()  # before anything is imported that could lie there

from ..commands.entry import view  # noqa: E402

sys.exit(view())
