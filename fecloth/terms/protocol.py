"""What a system asks of a term, and words for what one of a user's own does not offer."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fecloth.errors import InputError, brief
from fecloth.fabric.panel import Panel
from fecloth.mesh.cloth import Cloth

ALWAYS = (
    "name",
    "symmetric",
    "has_energy",
    "dissipative",
    "velocity_dependent",
    "add_force",
    "add_tangent",
    "rate_bounds",
)


def stencil(term, cloth: Cloth) -> np.ndarray | None:
    """The nodes (m, k) that a term couples, or None.

    Raises
    ------
    InputError
        For another shape, what is no whole number, and nodes that the cloth does not have.
    """
    nodes, name = term.stencil(cloth), type(term).__name__
    if nodes is None:
        return None
    if not (isinstance(nodes, np.ndarray) and nodes.ndim == 2 and nodes.dtype.kind in "iu"):
        what = f"stencil(cloth) = {brief(nodes)}"
        if isinstance(nodes, np.ndarray):
            what = f"stencil(cloth) of shape {nodes.shape} and type {nodes.dtype}"
        raise InputError(what, "must be an array (m, k) of nodes, or None", name)
    if nodes.size and not 0 <= nodes.min() <= nodes.max() < len(cloth.X):
        what = f"stencil(cloth) with the nodes {nodes.min()} … {nodes.max()}"
        raise InputError(what, f"must lie in 0 … {len(cloth.X) - 1}", name)
    return nodes


def bound(term, panel: Panel, slots: Callable):
    """The bound term.

    Raises
    ------
    InputError
        If it lacks what `fecloth.terms` says that every bound term offers.
    """
    made = term.bind(panel, slots)
    wanted = list(ALWAYS)
    wanted += ["energy"] if getattr(made, "has_energy", False) else []
    wanted += ["power"] if getattr(made, "dissipative", False) else []
    if missing := [name for name in wanted if not hasattr(made, name)]:
        what = f"{type(term).__name__}.bind(panel, slots) gives a {type(made).__name__}"
        remedy = "help(fecloth.terms) says what each is."
        raise InputError(what, f"must have {', '.join(missing)}", "System", remedy)
    return made
