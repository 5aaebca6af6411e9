"""A thin strip hangs as the heavy elastica: P2 with the interpolated strain does not lock.

The reference is inextensible and shares no code with the triangles (`studies.references.elastica`).
"""

import numpy as np
import pytest
from support.locking import LIMITS, LOCAL, PATTERNS, hang
from support.tiers import stories_except

from studies.references.elastica import heavy_elastica


def test_the_reference_is_the_known_curve():
    """A light strip is a cantilever, tip at Γ/8 (1 − O(Γ²)); the heavy one as in the literature."""
    _, reach, drop = heavy_elastica(10.0)
    assert drop[-1] / reach[-1] == pytest.approx(1.066802320, abs=1e-8)
    _, reach, drop = heavy_elastica(1e-3)
    assert drop[-1] == pytest.approx(1e-3 / 8, rel=1e-6)
    s, reach, drop = heavy_elastica(100.0)
    lengths = np.hypot(np.diff(reach), np.diff(drop))
    assert lengths == pytest.approx(np.diff(s), rel=1e-5)


@pytest.mark.parametrize("pattern", stories_except(PATTERNS, "right", "unstructured"))
def test_interpolated_strain_does_not_lock(pattern):
    errors = {n: abs(hang(LOCAL, pattern, 1e7, n)) for n in LIMITS}
    assert all(errors[n] < limit for n, limit in LIMITS.items()), errors


@pytest.mark.parametrize("pattern", stories_except(PATTERNS, "right", "cross"))
def test_pointwise_strain_locks(pattern):
    """So the test above tells a membrane that locks from one that does not."""
    error = hang("P2, pointwise strain", pattern, 1e7, 16)
    assert -0.4 < error < -0.25


@pytest.mark.parametrize(
    ("pattern", "ratio", "limits"),
    [("right", 1e6, (4.6e-3, 1.2e-3)), ("unstructured", 1e5, (3.2e-3, 9e-4))],
)
def test_linear_triangles_on_meshes_and_cloth_where_they_do_not_lock(pattern, ratio, limits):
    errors = [hang("P1", pattern, ratio, n, width=0.25) for n in (16, 32)]
    assert np.all(np.abs(errors) < limits)
    if pattern == "right":
        assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)
