"""Constants that nobody measured: how far published fabrics are spread about an estimate."""

import math
from dataclasses import dataclass
from typing import Any

FENG = (
    "Feng, Huang, Xu and Wang (2022), Learning-Based Bending Stiffness Parameter Estimation by a "
    "Drape Tester, ACM Trans. Graph. 41(6), cantilever tests of 618 fabrics, "
    "github.com/DrapeTester/ClothDrapeTester, dataset/dataset.csv"
)


@dataclass(frozen=True)
class Prior:
    """How far a number lies from its estimate among published fabrics.

    Attributes
    ----------
    what
        The number.
    estimate
        What it is taken as.
    spread
        Standard deviation of ln(number/estimate); None where no source was found, so that the
        uncertainty is unknown.
    source
        Authors, year and place; "" for none.
    """

    what: str
    estimate: str
    spread: float | None
    source: str = ""


BIAS = Prior("bias_rigidity", "Huber's estimate, (√B₁ + √B₂)²/4", 0.52, FENG)
PRIORS = (
    BIAS,
    Prior("bending_rigidity, warp over weft", "1", 0.73, FENG),
    Prior("angle of cut, grain_degrees", "as marked on the cloth", None),
    Prior("thickness", "as printed", None),
)


def huber(warp: float, weft: float) -> float:
    """Return Huber's B₄₅ [N m]: (B₁ + B₂ + 2 √(B₁ B₂))/4, for each Poisson's ratio of bending.

    Source: Timoshenko and Woinowsky-Krieger (1959), Theory of Plates and Shells,
    section 86; see `Fabric.plate`.
    """
    return (math.sqrt(warp) + math.sqrt(weft)) ** 2 / 4


def estimates(fabric: Any) -> dict[str, tuple[float, float]]:
    """Return the value and the standard uncertainty of constants that a `Fabric` leaves out.

    It is the rigidity along the bias, of a fabric that has rigidities along the yarns.
    """
    if fabric.bias_rigidity is not None or not fabric.bending_rigidity:
        return {}
    warp, weft = fabric.bending
    value = huber(warp, weft)
    assert BIAS.spread
    return {"bias_rigidity": (value, BIAS.spread * value)} if value else {}
