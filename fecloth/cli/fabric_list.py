"""The published fabrics as a page to read: `fecloth info --fabrics`."""

from __future__ import annotations

import textwrap

from fecloth.fabric.fabric import Fabric

WIDTH = 100


def list_fabrics() -> list[str]:
    """Return lines with the constants of each fabric, its kind, and the numbered sources."""
    fabrics = {name: Fabric.preset(name) for name in Fabric.presets()}
    table = [_row(name, fabric) for name, fabric in fabrics.items()]
    numbers: dict[str, int] = {}
    what = []
    for name, fabric in fabrics.items():
        kind, _, source = fabric.source.partition(". ")
        number = numbers.setdefault(source, len(numbers) + 1)
        what.append(f"{name}: {kind} [{number}]")
    sources = [_wrap(f"[{number}] {source}") for source, number in numbers.items()]
    return [_header(), *table, "", *what, "", *sources]


def _header() -> str:
    head = f"{'preset':<21}{'g/m²':>5}{'Y [N/m]':>15}{'G [N/m]':>9}{'ν':>6}{'B [µN m]':>12}"
    return f"{head}  (warp / weft; small strain)"


def _row(name: str, fabric: Fabric) -> str:
    tensile = " / ".join(f"{value:.0f}" for value in fabric.tensile)
    bending = " / ".join(f"{1e6 * value:.1f}" for value in fabric.bending or ()) or "unknown"
    return (
        f"{name:<21}{1000 * fabric.areal_density:>5.0f}{tensile:>15}{fabric.shear:>9.0f}"
        f"{fabric.poisson_ratio:>6.2f}{bending:>12}"
    )


def _wrap(text: str) -> str:
    return textwrap.fill(
        text, WIDTH, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False
    )
