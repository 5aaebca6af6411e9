"""python -m fecloth."""

import sys

from fecloth.cli.main import main

sys.exit(main())
