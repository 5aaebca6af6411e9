"""Studies of your own problem, and the engine of refinement, comparison and cost studies.

A study is a list of settings, a function that takes one setting and returns numbers, and
findings: numbers with an expected range. The exit status is 0 if all are met, 1 if one is
missed, 2 for a mistake in the input, 3 if a case failed. The section "A study" of
CONTRIBUTING.md has one in 30 lines.

The public names stand in ``__init__.pyi``. Each is imported when it is first used. A script
whose cases run in its own process imports `fecloth.study.threads` before NumPy: one thread a
library.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
