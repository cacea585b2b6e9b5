"""python -m deformrf.viewer"""

import sys

from .command import main

sys.exit(main())
