"""python -m deformrf.viewer"""

import sys

from .entry import view

sys.exit(view())
