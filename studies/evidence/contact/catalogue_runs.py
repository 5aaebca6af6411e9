"""Run a scene of the catalogue, and look at the state after every step."""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator
from itertools import pairwise, starmap

import ipctk
import numpy as np

import fecloth as fc
from fecloth import study
from fecloth.mesh.surface import Surface, count_intersections, find_intersections
from fecloth.terms.contact.bound_contact import BoundContact
from fecloth.terms.contact.bound_obstacle import BoundObstacle
from fecloth.terms.contact.inside import cutting_depth
from fecloth.terms.contact.points import MOST_DIP_OVER_GAP
from fecloth.terms.kinematics import largest_stretch
from studies.evidence.contact.catalogue_bodies import Body
from studies.evidence.contact.catalogue_scenes import Scene, draw, inner_points

PARTS = 64  # of a step, at which it is looked whether a triangle passes over a point


def watch(kind: str, seed: int, number: int, most: int | None = None) -> dict:
    """Counts of crossings and piercings, least distances and cost, of all steps of a scene.

    A scene is left after the step in which it has had `most` iterations.
    """
    warnings.simplefilter("ignore", fc.FeclothWarning)
    ipctk.set_num_threads(1)  # then all contacts have the same order in each run
    scene = draw(kind, seed, number)
    row: dict = {
        "triangles": len(surface_of(scene)),
        "end": "finished",
    }
    row |= {"message": "", "crossings": 0, "piercings": 0, "least": 1.0, "least_inside": 1.0}
    row |= {"steps": 0, "rejected": 0, "newton": 0, "cpu_seconds": 0.0}
    before, begin = scene.start, time.process_time()
    march = fc.march(
        *(scene.system, scene.method, scene.start, scene.dt, scene.t_end), newton=scene.newton
    )
    try:
        for state, info in march:
            row["cpu_seconds"] += time.process_time() - begin
            study.check_time_limit()
            look(scene, before, state, row)
            row["steps"] += 1
            row["rejected"] += info.counts.rejected
            row["newton"] += info.counts.newton
            before, begin = state, time.process_time()
            if most and row["newton"] >= most:
                break
    except fc.StepFailed as failure:
        row |= {"end": "lost", "message": str(failure)}
        row["cpu_seconds"] += time.process_time() - begin
    return row


def surface_of(scene: Scene) -> np.ndarray:
    triangles: np.ndarray = Surface.from_cloth(scene.system.cloth).triangles
    return triangles


def obstacles_of(scene: Scene) -> list:
    """The bound terms of its bodies."""
    bound = (term for term in scene.system.bound if isinstance(term, BoundContact))
    return [term for term in bound if term.name != "SelfContact"]


def look(scene: Scene, before: fc.State, state: fc.State, row: dict) -> None:
    """Add to a row what is wrong after a step."""
    cloth, triangles = scene.system.cloth, surface_of(scene)
    crossings = count_intersections(triangles, state.x)
    row["crossings"] += len(triangles) if crossings is None else crossings
    for body, term in zip(scene.bodies, obstacles_of(scene), strict=True):
        announced = 0.0
        if isinstance(term, BoundObstacle):  # between its points triangles dip by so much
            stretch = max(1.0, largest_stretch(cloth, state.x))
            told = cutting_depth(term.shape, term.gap, cloth, stretch)
            announced = max(told, MOST_DIP_OVER_GAP * term.gap)
        row["piercings"] += count_piercings(body, triangles, before, state, announced)
        if body.depth is not None:
            row["least"] = min(row["least"], -float(body.deep(state.x, state.t).max()))
            depth = float(body.deep(inner_points(state.x, triangles), state.t).max())
            row["least_inside"] = min(row["least_inside"], announced - depth)


def count_piercings(
    body: Body, triangles: np.ndarray, before: fc.State, state: fc.State, announced: float
) -> int:
    """Triangles that a body pierces after a step, or that passed over its middle in it."""
    y0, y1 = (body.to_frame(at.x, at.t) for at in (before, state))
    lines = np.sign(body.lines) * np.maximum(abs(body.lines) - announced, 0.0)
    cut = count_cut(lines, y1[triangles]) + count_cut_by_mesh(body, triangles, y1)
    return cut + count_swept(body.inner, y0[triangles], y1[triangles])


def count_cut(lines: np.ndarray, corners: np.ndarray) -> int:
    """Pairs of a segment (k, 2, 3) and a triangle (s, 3, 3) that it cuts."""
    cut = 0
    for a, b in lines:
        side = [volume(corners, point) for point in (a, b)]
        turns = [volume_of(corners[:, i], corners[:, (i + 1) % 3], a, b) for i in range(3)]
        same = np.all(np.array(turns) > 0, axis=0) | np.all(np.array(turns) < 0, axis=0)
        cut += int((same & (side[0] * side[1] < 0)).sum())
    return cut


def volume(corners: np.ndarray, point: np.ndarray) -> np.ndarray:
    """(s,) six times the volumes of triangles (s, 3, 3) and a point."""
    a, b, c = np.moveaxis(corners - point, 1, 0)
    six: np.ndarray = np.einsum("si,si->s", a, np.cross(b, c))
    return six


def volume_of(p: np.ndarray, q: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(s,) six times the volumes of edges p, q (s, 3) and the segment from a to b."""
    six: np.ndarray = np.einsum("si,si->s", p - a, np.cross(q - a, b - a))
    return six


def count_cut_by_mesh(body: Body, triangles: np.ndarray, y: np.ndarray) -> int:
    """Pairs of a triangle of the cloth and a triangle of the mesh that pass through each other."""
    if body.triangles is None:
        return 0
    count = 3 * len(body.triangles)
    both = np.vstack([triangles, len(y) + np.arange(count).reshape(-1, 3)])
    pairs = find_intersections(both, np.vstack([y, body.triangles.reshape(-1, 3)]))
    if pairs is None:
        return len(triangles)
    of_cloth = pairs < len(triangles)
    return int((of_cloth[:, 0] != of_cloth[:, 1]).sum())


def count_swept(points: np.ndarray, begin: np.ndarray, end: np.ndarray) -> int:
    """Pairs of a point and a triangle that passes over it, on the straight way of a step."""
    low, high = (of(np.concatenate([begin, end], axis=1), axis=1) for of in (np.min, np.max))
    swept, parts = 0, np.linspace(0, 1, PARTS + 1)
    for point in points:
        near = ((low < point) & (point < high)).all(axis=1)
        if near.any():
            ways = [begin[near] + s * (end[near] - begin[near]) for s in parts]
            swept += sum(starmap(contains, passes(ways, point)))
    return swept


def passes(ways: list[np.ndarray], point: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Triangles (3, 3) at the moment when a point lies in their plane, and this point."""
    volumes = np.array([volume(corners, point) for corners in ways])
    for part, triangle in np.argwhere(volumes[:-1] * volumes[1:] < 0):
        before, after = volumes[part : part + 2, triangle]
        s, corners = before / (before - after), (each[triangle] for each in ways[part : part + 2])
        a, b = corners
        yield a + s * (b - a), point


def contains(corners: np.ndarray, point: np.ndarray) -> bool:
    """Whether a point in the plane of a triangle (3, 3) lies inside it."""
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    ring = [*corners, corners[0]]
    return all(np.cross(q - p, point - p) @ normal > 0 for p, q in pairwise(ring))
