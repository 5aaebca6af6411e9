"""Orders of convergence and error estimates from runs alone, where no exact solution is known.

If u_h = u + C h^p, and h is halved from one run to the next, then (Richardson; see Roache 1994,
J. Fluids Eng. 116, 405–413)

    p = log₂ |u₁ − u₂| / |u₂ − u₃|,    |u₃ − u| = |u₂ − u₃| / (2^p − 1).
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

import numpy as np

import fecloth as fc
from fecloth.scene.scene import load_scene
from fecloth.study.cases import run_cases
from fecloth.study.options import run_options
from fecloth.study.reports import require_results, write_report
from fecloth.study.status import check_time_limit
from fecloth.study.workload import Workload, check_scene

Rows = list[dict]
LEAST_ORDER = 0.7  # below it the differences do not fall as those of a method of first order
CHANGES = "first halving changes it by [%]", "second halving [%]"
RELATIVE = "estimated error [% of the displacement]"


def distances(cloths: list[fc.Cloth], ends: list, norm: str = "l2") -> np.ndarray:
    """Return the norms of the differences between fields on successive meshes.

    Parameters
    ----------
    cloths
        Meshes, coarse to fine.
    ends
        One array of nodal values for each mesh.
    norm
        "l2" for the fields, "h1" for their gradients.
    """
    difference = [getattr(cloth, f"{norm}_difference") for cloth in cloths]
    pairs = range(len(cloths) - 1)
    return np.array([difference[i](cloths[i + 1], ends[i], ends[i + 1]) for i in pairs])


def orders(differences: np.ndarray) -> np.ndarray:
    """Return p for each two successive differences; NaN where their sign changes.

    Examples
    --------
    >>> orders(np.diff([1.04, 1.01, 1.0025]))
    array([2.])
    """
    ratio = np.asarray(differences[:-1]) / differences[1:]
    return np.log2(np.where(ratio > 0, ratio, np.nan)).round(9)


def remaining_error(differences: np.ndarray) -> float:
    """Estimate the error u − u₃ of the finest run, with the sign of the differences.

    Examples
    --------
    >>> round(remaining_error(np.diff([1.04, 1.01, 1.0025])), 9)  # 1 − 1.0025
    -0.0025
    """
    return float(differences[-1] / (2 ** orders(differences)[-1] - 1))


def refine_scene(options) -> int:
    """Halve h and dt of a scene twice each, and report the error of the original by either.

    Raises
    ------
    SceneError
        If the scene has no cloth.h.
    """
    path = str(options.scene.resolve())
    scene, digest = load_scene(path), hashlib.sha256(options.scene.read_bytes()).hexdigest()[:12]
    if scene.cloth.h is None:
        allowed = "needs cloth.h, so that it can be halved"
        raise fc.SceneError("a mesh of one size", allowed, path, "Give a .geo file and h.")
    meshes, steps = [(0, 0), (1, 0), (2, 0)], [(0, 0), (0, 1), (0, 2)]
    levels = list(dict.fromkeys(meshes + (scene.time.dt != "auto") * steps))
    dt = scene.time.dt
    sizes = [Workload.of(scene, 2**m, dt / 2**s if s else None) for m, s in levels]
    check_scene(sizes, options)
    shared = {"path": path, "digest": digest}
    cases = [shared | {"finer_mesh": m, "finer_step": s} for m, s in levels]
    running = run_options(options) | {"time_limit": options.time_limit, "label": describe_level}
    rows = run_cases(cases, run_refined_scene, **running, costs=[size.seconds for size in sizes])
    title = f"Convergence of {options.scene.stem}"
    require_results(options, title, rows)
    ends = dict(zip(levels, rows, strict=True))
    cloths = [load_scene(path, [f"cloth.h={scene.cloth.h / 2**k!r}"]).mesh() for k in range(3)]
    table = [estimate_error("edge length h", cloths, [ends[key] for key in meshes])]
    if len(levels) > 3:
        table.append(estimate_error("time step dt", [cloths[0]] * 3, [ends[key] for key in steps]))
    return write_report(
        options,
        title,
        [{k: v for k, v in row.items() if k != "x"} for row in rows],
        tables={"Error of the scene, from h and from dt": table},
        conclusion=describe_errors(table),
    )


def describe_level(settings: Mapping) -> str:
    """Return which of h and dt a case refines."""
    parts = [
        f"{name} / {2 ** settings[key]}"
        for name, key in (("h", "finer_mesh"), ("dt", "finer_step"))
        if settings[key]
    ]
    return " and ".join(parts) or "the scene as it is"


def describe_errors(table: Rows) -> str:
    """Return two sentences: the error by h and the error by dt, or that it does not converge."""
    lines = []
    for row in table:
        error, name = row.get(RELATIVE, np.nan), row["halved"]
        if "order" not in row:
            lines.append(f"- {name}: no estimate, because a run failed.")
        elif row["order"] >= LEAST_ORDER:
            lines.append(
                f"- {name}: the error of the scene is about {error:.2g} % of its displacement "
                f"(observed order {row['order']:.2g})."
            )
        else:
            lines.append(
                f"- {name}: the scene does not converge (observed order {row['order']:.2g}): "
                f"two halvings change it by {row[CHANGES[0]]:.2g} % and {row[CHANGES[1]]:.2g} % "
                "of its displacement."
            )
    lines.append(
        "\nTrust an estimate only if its order is the one that the method claims. "
        "A low order in dt often comes from solver.tolerance: try 1e-10."
    )
    return "\n".join(lines)


def run_refined_scene(path: str, digest: str, finer_mesh: int, finer_step: int) -> dict:
    """Run a scene with h and dt halved that many times, and return its end.

    `digest` is the hash of the scene file: it makes an edited scene another case.
    """
    scene = load_scene(path)
    overrides = [f"cloth.h={scene.cloth.h / 2**finer_mesh!r}"]
    if finer_step:
        overrides.append(f"time.dt={scene.time.dt / 2**finer_step!r}")
    built = load_scene(path, overrides).build()
    end = fc.run(
        built.system,
        built.method,
        built.state,
        built.dt,
        built.t_end,
        solver=built.linear,
        newton=built.newton,
        report=check_time_limit,
    )
    return {"nodes": len(built.cloth.X), "x": end.state.x.tolist()}


def estimate_error(name: str, cloths: list[fc.Cloth], rows: Rows) -> dict:
    """Return the table's line for h or dt: distances, order and error of the coarsest run."""
    if any(row["status"] != "ok" for row in rows):
        return {"halved": name, "status": "a run failed"}
    ends = [np.array(row["x"]) for row in rows]
    apart = distances(cloths, ends)
    flat = np.column_stack([cloths[0].X, np.zeros(len(cloths[0].X))])
    percent = 100 / cloths[0].l2_norm(ends[0] - flat)
    p = float(orders(apart)[0]) if apart.all() else np.nan
    error = apart[0] / (1 - 2.0**-p) if p > 0 else np.nan
    return {
        "halved": name,
        CHANGES[0]: percent * apart[0],
        CHANGES[1]: percent * apart[1],
        "order": p,
        RELATIVE: percent * error,
        "error [m²]": error,
    }
