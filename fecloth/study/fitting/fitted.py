"""The tables of fitted.toml: the fitted fabric and terms, and how uncertain they are.

A scene reads them by the key `file` of its [fabric], see `fecloth/scene/fitted.py`.
"""

from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np

from fecloth.fabric.merging import merged
from fecloth.fabric.uncertainty import UNKNOWN
from fecloth.study.constants_read import numbers_read
from fecloth.study.fitting.discrepancy import Discrepancy
from fecloth.study.fitting.evaluation import Fitting
from fecloth.study.fitting.fabric import fabric_with
from fecloth.study.uncertainty import COVERS

OF_FABRIC, OF_TERMS = "fabric.", "terms."


def fitted_tables(
    fitting: Fitting,
    values: Mapping[str, float],
    intervals: Mapping[str, tuple[float, float]],
    covariance: np.ndarray,
    scale: Discrepancy | None,
    slack: float,
) -> dict[str, Any]:
    """Return the tables of fitted.toml.

    [fabric] is the one of the first scene, with the fitted constants; [[terms]] are the terms of
    the scenes that have fitted numbers, as curves. What is neither stands in [parameters].

    Constants with an interval have a standard uncertainty and correlations, in [fabric.uncertainty]
    and, by the type of the term, in [uncertain]. It is so large that twice of it covers 95 %; so
    are the ones of specimens and of the law. Other constants that were fitted, or that the
    specimens depend on, are "unknown", unless the fabric of the fit states their uncertainty.
    `covariance` (k, k) is the one of `values`, in their order; `slack` is the uncertainty of the
    slack of the next specimen [m], NaN if it is not known.
    """
    table = next(filter(None, (s.problem.tables.get("fabric") for s in fitting.specimens)), None)
    terms, keys = _fitted_terms(fitting, values)
    if table:
        keys |= {name: name for name in values if name.startswith(OF_FABRIC)}
    widened = scale.quantile / COVERS if scale else np.nan
    deviations = widened * np.sqrt(np.diag(covariance))
    told = [i for i, name in enumerate(values) if scale and np.isfinite(intervals[name][0])]
    told = [i for i in told if list(values)[i] in keys]
    names = [keys.get(name, name) for name in values]
    uncertain: dict[str, Any] = dict.fromkeys(keys.values(), UNKNOWN)
    uncertain |= {names[i]: float(deviations[i]) for i in told}
    rows: list[list[Any]] = []
    for i, j in combinations(told, 2):
        rho = covariance[i, j] / np.sqrt(covariance[i, i] * covariance[j, j])
        rows.append([names[i], names[j], float(rho)])
    of_curves = {}
    if scale and told:
        both = {"specimen": scale.specimens, "law": scale.law}
        of_curves = {key: float(widened * u) for key, u in both.items() if u > 0}
    tables: dict[str, Any] = {
        "parameters": {name: value for name, value in values.items() if name not in keys},
        "terms": terms,
        "uncertain": {key: u for key, u in uncertain.items() if key.startswith(OF_TERMS)},
    }
    if slack > 0:
        tables["uncertain"]["slack"] = slack
    if others := [row for row in rows if not all(key.startswith(OF_FABRIC) for key in row[:2])]:
        tables["uncertain"]["correlation"] = others
    if table and keys:
        of_fabric = [row for row in rows if row not in others]
        tables["fabric"] = _fabric(fitting, table, values, uncertain, of_fabric)
        tables["fabric"]["uncertainty"] |= of_curves
    return tables


def _fitted_terms(
    fitting: Fitting, values: Mapping[str, float]
) -> tuple[list[dict[str, Any]], dict[str, str]]:
    """Return the tables of terms with fitted numbers, and "terms.TYPE.KEY" of these by name.

    A term whose type a scene has several times is left out.
    """
    terms: dict[str, dict[str, Any]] = {}
    keys: dict[str, str] = {}
    for specimen in fitting.specimens:
        new = [name for name in specimen.names if name.startswith(OF_TERMS) and name not in keys]
        if not new or not specimen.problem.source.fabrics:
            continue
        at = specimen.problem.at({name: values[name] for name in specimen.names})
        types = [term["type"] for term in at.tables["terms"]]
        for name in new:
            _, number, *rest = name.split(".")
            kind = types[int(number)]
            if types.count(kind) == 1:
                terms[kind] = at.tables["terms"][int(number)]
                keys[name] = f"{OF_TERMS}{kind}.{'.'.join(rest)}"
    return list(terms.values()), keys


def _fabric(
    fitting: Fitting,
    table: Mapping[str, Any],
    values: Mapping[str, float],
    uncertain: Mapping[str, Any],
    rows: list[list[Any]],
) -> dict[str, Any]:
    """Return the table [fabric] with fitted constants, and with its table of uncertainties."""
    fabric = fabric_with(table, values)
    read = [name for specimen in fitting.specimens for name in numbers_read(specimen.problem)]
    unknown = dict.fromkeys((name.removeprefix(OF_FABRIC) for name in read), UNKNOWN)
    own = {
        key.removeprefix(OF_FABRIC): u for key, u in uncertain.items() if key.startswith(OF_FABRIC)
    }
    table_of_fabric = merged(
        unknown | dict.fromkeys(own, UNKNOWN), (), fabric.get("uncertainty", {})
    )
    table_of_fabric |= {key: u for key, u in own.items() if u != UNKNOWN}
    if rows:
        table_of_fabric["correlation"] = [
            [first.removeprefix(OF_FABRIC), second.removeprefix(OF_FABRIC), rho]
            for first, second, rho in rows
        ]
    return fabric | {"uncertainty": table_of_fabric}
