"""A processor clock that counts work, for studies that compare the seconds of runs."""

import itertools
import time

import pytest

from fecloth.system.system import System

FORCE, TANGENT = 1e-7, 1e-6  # seconds of a term on a triangle


@pytest.fixture(scope="module")
def counted_work():
    """Every reading of the clock and each term, by its triangles, take always the same time."""
    seconds = itertools.count()
    work = [0.0]

    def counted(method, cost):
        def call(system, *args, **options):
            work[0] += cost * (10 + len(system.cloth.triangles) * len(system.bound))
            return method(system, *args, **options)

        return call

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(System, "force", counted(System.force, FORCE))
        patch.setattr(System, "add_tangents", counted(System.add_tangents, TANGENT))
        patch.setattr(time, "process_time", lambda: work[0] + 1e-6 * next(seconds))
        yield
