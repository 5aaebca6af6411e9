"""Self-convergence: what the distances between ever finer answers tell where nothing is exact.

If u_h = u + C h^p with h halved from one answer to the next, then (Richardson; see Roache 1994,
J. Fluids Eng. 116, 405–413)

    p = log₂ |u₁ − u₂| / |u₂ − u₃|,    |u₃ − u| = |u₂ − u₃| / (2^p − 1).
"""

from __future__ import annotations

import hashlib

import numpy as np

import fecloth as fc
from fecloth.scene.scene import load
from fecloth.study.cases import run_cases
from fecloth.study.options import running
from fecloth.study.reports import report
from fecloth.study.status import tick

Rows = list[dict]


def distances(cloths: list[fc.Cloth], ends: list, norm: str = "l2") -> np.ndarray:
    """The L2 norms of what neighbouring fields differ by, or of their gradients ("h1")."""
    differ = [getattr(cloth, f"{norm}_difference") for cloth in cloths]
    steps = range(len(cloths) - 1)
    return np.array([differ[i](cloths[i + 1], ends[i], ends[i + 1]) for i in steps])


def orders(differences: np.ndarray) -> np.ndarray:
    """p of each three neighbouring answers; NaN where the differences turn round.

    Examples
    --------
    >>> orders(np.diff([1.04, 1.01, 1.0025]))
    array([2.])
    """
    ratio = np.asarray(differences[:-1]) / differences[1:]
    return np.log2(np.where(ratio > 0, ratio, np.nan)).round(9)


def left(differences: np.ndarray) -> float:
    """What the finest answer is still off by, with its sign if the differences have one.

    Examples
    --------
    >>> round(left(np.diff([1.04, 1.01, 1.0025])), 9)  # 1 − 1.0025
    -0.0025
    """
    return float(differences[-1] / (2 ** orders(differences)[-1] - 1))


def of_scene(options) -> int:
    """A user's scene: h and dt halved twice, and what the scene as given is off by for each."""
    path = str(options.scene.resolve())
    given, digest = load(path), hashlib.sha256(options.scene.read_bytes()).hexdigest()[:12]
    if given.cloth.h is None:
        allowed = "needs cloth.h, so that it can be halved"
        raise fc.SceneError("a mesh of one size", allowed, path, "Give a .geo file and h.")
    meshes, steps = [(0, 0), (1, 0), (2, 0)], [(0, 0), (0, 1), (0, 2)]
    wanted = list(dict.fromkeys(meshes + (given.time.dt != "auto") * steps))
    shared = {"path": path, "digest": digest}
    cases = [shared | {"finer_mesh": m, "finer_step": s} for m, s in wanted]
    rows = run_cases(cases, own, **running(options))
    ends = dict(zip(wanted, rows, strict=True))
    cloths = [load(path, [f"cloth.h={given.cloth.h / 2**k!r}"]).mesh() for k in range(3)]
    table = [halving("edge length h", cloths, [ends[key] for key in meshes])]
    if len(wanted) > 3:
        table.append(halving("time step dt", [cloths[0]] * 3, [ends[key] for key in steps]))
    shown = [{k: v for k, v in row.items() if k != "x"} for row in rows]
    tables = {"What the scene is off by, by either alone": table}
    words = (
        "An estimate stands on its order: believe it where that is one that the method claims. "
        "A low order in dt often is solver.tolerance, 1e-6 if not given: try 1e-10."
    )
    title = f"Convergence of {options.scene}"
    return report(options, title, shown, tables=tables, conclusion=words)


def own(path: str, digest: str, finer_mesh: int, finer_step: int) -> dict:
    """The end of a scene whose h is halved so often, and whose dt.

    `digest` is of the file, so that a change of it is another case.
    """
    given = load(path)
    halved = [f"cloth.h={given.cloth.h / 2**finer_mesh!r}"]
    if finer_step:
        halved.append(f"time.dt={given.time.dt / 2**finer_step!r}")
    built = load(path, halved).build()
    end = fc.run(
        built.system,
        built.method,
        built.state,
        built.dt,
        built.t_end,
        solver=built.linear,
        newton=built.newton,
        report=tick,
    )
    return {"nodes": len(built.cloth.X), "x": end.state.x.tolist()}


def halving(name: str, cloths: list[fc.Cloth], rows: Rows) -> dict:
    """The line of one of the two."""
    if any(row["status"] != "ok" for row in rows):
        return {"halved": name, "status": "a run failed"}
    ends = [np.array(row["x"]) for row in rows]
    apart = distances(cloths, ends)
    flat = np.column_stack([cloths[0].X, np.zeros(len(cloths[0].X))])
    p = float(orders(apart)[0]) if apart.all() else np.nan
    line = {"halved": name, "L2 distance 1 [m²]": apart[0], "L2 distance 2 [m²]": apart[1]}
    line |= {"order": p, "error as given [m²]": apart[0] / (1 - 2.0**-p) if p > 0 else np.nan}
    scale = cloths[0].l2_norm(ends[0] - flat)
    return line | {"of the L2 norm of x − X": line["error as given [m²]"] / scale}
