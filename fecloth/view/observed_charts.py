"""Charts of observed.csv: probes, sag, area and the reactions of the pins."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fecloth.view.svg_chart import chart

MOST = 6  # charts of probes, and of pins; the others are only in observed.csv
REACTION = "reaction:"


def observed_charts(table: Mapping[str, np.ndarray]) -> list[str]:
    """Return a <figure> for each probe, for sag and area, and for each pin and obstacle its force.

    `table` has the columns of observed.csv; without rows there is no figure.
    """
    if not table:
        return []
    vectors = [name.removesuffix(".x") for name in table if name.endswith(".x")]
    pins = [name for name in vectors if name.startswith(REACTION)]
    probes = [name for name in vectors if name not in pins]
    shown = [(_title(name), _components(table, name), "[m]") for name in probes[:MOST]]
    shown += [("Sag", {"sag": table["sag"]}, "[m]"), ("Area", {"area": table["area"]}, "[m²]")]
    for name in pins[:MOST]:
        obstacle = name.removeprefix(REACTION)
        least = table.get(f"least_distance:{obstacle}")
        title = _title(name) if least is None else f"Force of the obstacle {obstacle}"
        shown.append((title, _components(table, name), "[N]"))
        if least is not None:
            shown.append((f"Least distance from the obstacle {obstacle}", {"d": least}, "[m]"))
    return [_draw(table["t"], *figure) for figure in shown]


def _title(name: str) -> str:
    if name.startswith(REACTION):
        return f"Force of the pin {name.removeprefix(REACTION)}"
    return "Mean displacement" if name == "mean_displacement" else f"Position of {name}"


def _components(table, name: str) -> dict[str, np.ndarray]:
    return {component: table[f"{name}.{component}"] for component in "xyz"}


def _draw(t: np.ndarray, title: str, columns: Mapping[str, np.ndarray], unit: str) -> str:
    return chart(title, {name: (t, values) for name, values in columns.items()}, "t [s]", unit)
