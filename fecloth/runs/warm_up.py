"""Compilation of what a run will call, before its first step."""

import warnings
from contextlib import suppress
from dataclasses import replace

from fecloth.errors import FeclothError
from fecloth.mesh.cloth import Cloth
from fecloth.output.frame_arrays import fields
from fecloth.scene.problem import Problem
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.run import run
from fecloth.system.system import System


def compile_kernels(problem: Problem) -> None:
    """Compile what the run will call, on two triangles, before the first step."""
    # Compiled code is cached on disk; later runs load it.
    whole, halves = problem.system, {"lower": [0], "upper": [1]}
    corners, triangles = [(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 1, 2), (0, 2, 3)]
    sets, element = {"left": [0, 3]}, whole.cloth.element
    cloth = Cloth.from_arrays(corners, triangles, sets, regions=halves, element=element)
    # two triangles may have no equilibrium, and nothing new is compiled in a long search for it
    steps = problem.steps
    if isinstance(steps, LoadSteps):
        steps = replace(steps, load_steps=1, tolerance=0.5, max_iterations=4)
    first, *others = whole.panel.fabrics  # constants by triangle have another array layout
    fabric = {"lower": first, "upper": others[0]} if others else first
    # SuperLU compiles all that PARDISO needs, without loading the MKL
    automatic = ("superlu",) if problem.is_static else ("pcg", "superlu")
    for linear in automatic if problem.linear == "auto" else (problem.linear,):
        with suppress(FeclothError), warnings.catch_warnings(action="ignore"):
            # failures and warnings there say nothing about the scene
            system = System(cloth, fabric, whole.terms, ["left"], whole.mass_kind)
            start = system.state(1.01 * system.rest().x)
            fields(system, start)
            # four steps: the estimate of the error in time needs as many
            number = 1 if problem.is_static else 4
            run(system, steps, start, t_end=number * (steps.dt or 1e-4), solver=linear)
