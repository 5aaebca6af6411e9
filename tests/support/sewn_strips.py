"""A strip, the same one cut in two, and the seam between its halves."""

from dataclasses import replace
from functools import cache

import numpy as np

import fecloth as fc

SEAM = fc.Seam("a.right", "b.left")


def shifted(cloth: fc.Cloth, X: float, Y: float = 0.0) -> fc.Cloth:
    return replace(cloth, X=cloth.X + (X, Y))


@cache
def halves(h=(0.125, 0.1), apart=0.0, element="P1", pattern="unstructured") -> fc.Cloth:
    """Two halves of a strip of 1 m by 0.25 m, whose edges match only for equal h."""
    sizes = {"pattern": pattern, "element": element}
    a, b = (fc.Cloth.rectangle(0.5, 0.25, h=size, **sizes) for size in h)
    return fc.Cloth.join([a, shifted(b, 0.5 + apart)], names=["a", "b"])


def whole_and_cut(element: str, pattern: str, apart: float = 0.0) -> tuple[fc.Cloth, fc.Cloth]:
    """A strip, and the same one cut in two."""
    whole = fc.Cloth.rectangle(1.0, 0.25, h=0.125, pattern=pattern, element=element)
    return whole, halves((0.125, 0.125), apart, element, pattern)


def in_order(system: fc.System, X: np.ndarray) -> np.ndarray:
    """The nodes that follow no others, by their places X."""
    own = np.setdiff1d(np.arange(len(X)), system.constraints.followers.nodes)
    places = np.round(X[own], 9)
    return own[np.lexsort((places[:, 1], places[:, 0]))]
