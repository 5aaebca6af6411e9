"""What pins and obstacles force on a cloth that no contact allows is named, and its first event."""

import numpy as np
import pytest
from conftest import flat

import fecloth as fc
from fecloth.simulation.no_room import name_no_room

pytest.importorskip("ipctk")
FABRIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
HEIGHT = 0.01  # m between what meets, at 1 m/s


def sheets(contacts, pins):
    """Two flat sheets; the edges "lower/right", along y, and "upper/right", along x, cross."""
    piece = fc.Cloth.rectangle(0.1, 0.1, 0.05, pattern="right")
    cloth = fc.Cloth.join([piece, piece], names=["lower", "upper"])
    x = flat(cloth)
    above = cloth.nodes("upper")
    X, Y = cloth.X[above].T
    x[above] = np.column_stack([Y + 0.06, 0.17 - X, np.full(len(X), HEIGHT)])
    system = fc.System(cloth, FABRIC, [fc.StVK(), *contacts], pins)
    return system, system.state(x)


def plane(z, normal, speed):
    shape = fc.shapes.Plane((0, 0, z), (0, 0, normal), motion=(0, 0, f"{speed} * t"))
    return fc.Obstacle(shape, gap=1e-3)


def says(system, state, way):
    """The words for a horizon in which what meets at 1 m/s goes this way."""
    return name_no_room(system, state, way / 1.0)


@pytest.mark.parametrize(
    ("contact", "where"), [("itself", "through each other"), ("rod", "into"), ("ball", "into")]
)
def test_held_edges_that_meet_are_named(contact, where):
    """The ball meets points of an edge between its two nodes only."""
    up = fc.Pin("lower/right", motion=(0, 0, "t"))
    rod = fc.shapes.Capsule((0.0, 0.07, HEIGHT), (0.2, 0.07, HEIGHT), 2e-4)
    ball = fc.shapes.Sphere((0.1, 0.025, HEIGHT + 0.02), 0.02)
    contacts, pins = [fc.SelfContact(1e-3)], [up, fc.Pin("upper/right")]
    if contact != "itself":
        contacts, pins = [fc.Obstacle({"rod": rod, "ball": ball}[contact], 5e-4)], [up]
    system, start = sheets(contacts, pins)
    assert says(system, start, 0.8 * HEIGHT) == ""
    words = says(system, start, 1.25 * HEIGHT)
    assert where in words
    assert words.startswith(
        "the pins lower/right and upper/right"
        if contact == "itself"
        else "the pin lower/right would lead 2 held nodes into Obstacle"
    )
    numbers = [int(each) for each in words.split(": ")[1].split(", ") if each != "…"]
    held = system.constraints.nodes
    assert set(numbers) <= set(held.tolist())


def test_free_nodes_make_room():
    system, start = sheets([fc.SelfContact(1e-3)], [fc.Pin("lower/right", motion=(0, 0, "t"))])
    assert says(system, start, 2 * HEIGHT) == ""


@pytest.mark.parametrize("moved", [0, 1])
def test_two_obstacles_that_close_are_named(moved):
    speeds = [(1, 0), (0, -1)][moved]
    planes = [plane(-0.4 * HEIGHT, 1, speeds[0]), plane(1.6 * HEIGHT, -1, speeds[1])]
    system, start = sheets(planes, [])
    assert says(system, start, 0.8 * 2 * HEIGHT) == ""
    words = says(system, start, 1.25 * 2 * HEIGHT)
    assert words.startswith("Obstacle.1 and Obstacle.2 would pass through each other")
    assert "leave no room for the nodes 0, 1, 2, 3, 4, …" in words


def test_the_first_event_is_named():
    """The pin meets the lower plane before the planes close."""
    down = fc.Pin("lower/right", motion=(0, 0, "-t"))
    planes = [plane(-0.4 * HEIGHT, 1, 0), plane(1.6 * HEIGHT, -1, -1)]
    system, start = sheets(planes, [down])
    assert "lower/right would lead 3 held nodes into Obstacle.1" in says(system, start, HEIGHT * 4)
