"""python -m deformrf.viewer"""

import sys

from .app import main

sys.exit(main())
