"""python -m fecloth."""

import sys

from .cli import main

sys.exit(main())
