"""Studies run on one thread: the limit is set before the first of them imports NumPy."""

from fecloth.study import threads  # noqa: F401
