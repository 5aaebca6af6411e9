"""Run a scene of the catalogue, and look at the state after every step."""

from __future__ import annotations

import time
import warnings

import ipctk

import fecloth as fc
from fecloth import study
from fecloth.mesh.surface import count_intersections
from studies.contact.catalogue_scenes import drawn, inner_points, named

DT = 0.01  # s


def fall(case: str, seed: int, triangles: int, t_end: float, method: str) -> dict:
    """Counts of crossings, greatest depths in the obstacle, and cost, of all steps of a scene."""
    warnings.simplefilter("ignore", fc.FeclothWarning)
    ipctk.set_num_threads(1)  # then all contacts have the same order in each run
    scene = drawn(seed, triangles) if case == "drop" else named(case, triangles)
    system, cells = scene.system, scene.system.cloth.triangles
    energy = sum(system.energies(scene.start).values())
    row = {"crossings": 0, "node_depth": -1.0, "point_depth": -1.0, "newton": 0, "most_newton": 0}
    row |= {"frames": 0, "cpu_seconds": 0.0, "most_contacts": 0, "cells": len(cells)}
    contact, begin = system.bound[4], time.process_time()
    for state, info in fc.march(system, getattr(fc, method)(), scene.start, DT, t_end):
        row["cpu_seconds"] += time.process_time() - begin
        study.check_time_limit()
        found = count_intersections(cells, state.x)
        row["crossings"] += len(cells) if found is None else found
        if scene.depth is not None:
            row["node_depth"] = max(row["node_depth"], float(scene.depth(state.x).max()))
            points = scene.depth(inner_points(state.x, cells))
            row["point_depth"] = max(row["point_depth"], float(points.max()))
        row["most_contacts"] = max(row["most_contacts"], len(contact.sets.at(state.x)))
        row["newton"] += info.counts.newton
        row["most_newton"] = max(row["most_newton"], info.counts.newton)
        row["frames"] += 1
        begin = time.process_time()
    row["energy_lost"] = (energy - sum(system.energies(state).values())) if row["frames"] else 0.0
    return row
