"""Quantities of interest: the grammar, values in runs, differences between runs."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import fecloth as fc
from fecloth.mesh.surface import Enclosure
from fecloth.simulation.probes import Observer
from fecloth.simulation.quantity import parse_quantity
from fecloth.simulation.quantity_values import (
    RunRecord,
    difference_of,
    relative_difference,
    signal_period,
    size_of,
    value_of,
)

T = np.linspace(0, 2, 201)
COLUMNS = {"tip.x": 1 + 0 * T, "tip.y": 0 * T, "tip.z": 3 + np.sin(2 * np.pi * T) * np.exp(-T)}
COLUMNS |= {"sag": T**2, "StVK": 2 * T, "reaction:left.z": np.where(T > 0, 4.0, np.nan)}


def record(columns=COLUMNS, **more):
    return RunRecord(T, columns, probes=("tip",), **more)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("sag", 4.0),
        ("sag at the end", 4.0),
        ("sag at 0.5 s", 0.25),
        ("sag at 500ms", 0.25),
        ("sag at 5e-1", 0.25),
        ("energy.StVK at sag = 25 cm", 1.0),  # at 0.5 s
        ("energy.StVK at sag = 4", 4.0),  # at the end
        ("max sag", 4.0),
        ("min tip.z", COLUMNS["tip.z"].min()),
        ("energy.StVK", 4.0),
        ("StVK", 4.0),
        ("energy.Springs", 0.0),
        ("reaction.left.z", 4.0),
        ("min reaction:left.z", 4.0),
        ("path of sag", np.sqrt(np.mean(T[1:] ** 4))),
        ("tip.z", COLUMNS["tip.z"][-1]),
        ("  frequency ( 2 ) ", 5.0),
    ],
)
def test_values_of_numbers(text, value):
    assert_allclose(value_of(parse_quantity(text), record(frequencies=(3.0, 5.0))), value)


def test_a_change_may_be_a_fall():
    falling = record(COLUMNS | {"fall": 7 - T})
    assert value_of(parse_quantity("StVK at fall = -0.5 m"), falling) == pytest.approx(1.0)


def test_the_size_of_a_probe_is_that_of_its_displacement():
    moved = abs(COLUMNS["tip.z"][-1] - 3)
    for text in ("tip.z", "tip"):
        assert_allclose(size_of(parse_quantity(text), record()), moved, atol=1e-15)


def test_differences_of_vectors_paths_and_numbers():
    other = COLUMNS | {"tip.x": COLUMNS["tip.x"] + 0.15 * T, "tip.z": COLUMNS["tip.z"] + 0.4 * T}
    a, b = record(), record(other)
    assert_allclose(difference_of(parse_quantity("tip"), a, b), np.hypot(0.3, 0.8))
    assert_allclose(difference_of(parse_quantity("tip.z at 1 s"), a, b), 0.4)
    assert_allclose(
        difference_of(parse_quantity("path of tip.z"), a, b), 0.4 * np.sqrt(4 / 3), rtol=5e-3
    )
    shifted = record(other | {"tip.x": other["tip.x"] + 5})  # another place, the same motion
    path = parse_quantity("path of tip")
    for each in (b, shifted):
        assert_allclose(
            difference_of(path, a, each), np.hypot(0.15, 0.4) * np.sqrt(4 / 3), rtol=5e-3
        )
    assert_allclose(difference_of(parse_quantity("tip.x"), a, shifted), 0.3)
    assert relative_difference(parse_quantity("tip.y"), a, b) == 0
    assert_allclose(relative_difference(parse_quantity("tip.z"), b, a), 0.8 / 0.8)
    assert relative_difference(parse_quantity("tip.y"), b, record(other | {"tip.y": T})) == np.inf


def test_fields_in_l2_and_h1():
    """u = s X (Y, 0, 0) over the unit square: ‖u‖² = s²/9, ‖∇u‖² = 2 s²/3."""

    def run(h, slope):
        cloth = fc.Cloth.rectangle(1.0, 1.0, h, pattern="right", element="P2")
        u = slope * cloth.X[:, [0]] * cloth.X[:, [1]] * [[1.0, 0, 0]]
        return RunRecord(T, {}, cloth, {"displacement": u, "velocity": 2 * u})

    a, b = run(0.25, 1.0), run(0.125, 1.3)
    for text, size in (("displacement", 1 / 3), ("displacement in H1", np.sqrt(2 / 3))):
        assert_allclose(size_of(parse_quantity(text), a), size)
        assert_allclose(difference_of(parse_quantity(text), a, b), 0.3 * size)
    assert_allclose(value_of(parse_quantity("velocity in l2"), a), 2 / 3)


@pytest.mark.parametrize(
    ("text", "unit"),
    [("tip.z", "m"), ("energy.StVK", "J"), ("total", "J"), ("reaction.left.z", "N")]
    + [("path of tip", "m"), ("period of sag", "s"), ("frequency(1)", "Hz"), ("volume", "m³")]
    + [("displacement", "m²"), ("displacement in H1", "m"), ("largest_stretch", "")]
    + [("distance of a and b", "m"), ("max folds", ""), ("line_force.grip.x", "N/m")]
    + [("min drape_coefficient", "")],
)
def test_units(text, unit):
    assert parse_quantity(text).unit(["total"]) == unit


def test_a_function_of_the_result_is_a_quantity():
    def lowest(result):
        return result

    quantity = parse_quantity(lowest)
    assert (quantity.text, quantity.how) == ("lowest", "function")
    assert value_of(quantity, record(values={"lowest": 7.0})) == 7.0
    assert parse_quantity(quantity) is quantity


# --- periods --------------------------------------------------------------------------------------


@pytest.mark.parametrize("samples", [10, 16, 40])  # in a period
@pytest.mark.parametrize(("periods", "decay"), [(1.3, 0.0), (2.2, 0.0), (2.2, 0.1), (5.7, 0.1)])
def test_the_period_is_right_to_a_thousandth(samples, periods, decay, rng):
    """Uneven samples of a damped swing about 5, from any phase."""
    t = np.linspace(0, periods, int(samples * periods) + 1)
    t[1:-1] += 0.2 / samples * rng.uniform(-1, 1, len(t) - 2)
    for phase in np.arange(8):
        y = 5 + np.exp(-decay * t) * np.sin(2 * np.pi * t + phase)
        assert abs(signal_period(0.7 * t, y) / 0.7 - 1) < 1e-3


# --- shape ----------------------------------------------------------------------------------------


def test_the_volume_under_a_dome_and_in_a_tube():
    """A spherical cap: V = π h (3 a² + h²)/6. A tube has two caps: V = π R² L, wherever it is."""
    cloth = fc.Cloth.disk(1.0, 0.05)
    r = np.linalg.norm(cloth.X, axis=1)
    dome = np.column_stack([cloth.X, np.sqrt(np.maximum(4 - r**2, 0)) - np.sqrt(3)]) + [5, 6, 7]
    height = 2 - np.sqrt(3)
    exact = np.pi * height * (3 + height**2) / 6
    assert_allclose(
        Enclosure.from_triangles(cloth.triangles, len(dome)).volume(dome), exact, rtol=3e-3
    )
    n = 60
    angle = 2 * np.pi * np.arange(n) / n
    ring = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    a, b = np.arange(n), (np.arange(n) + 1) % n
    tube = np.concatenate([np.column_stack([a, b, a + n]), np.column_stack([b, b + n, a + n])])
    x = np.concatenate([ring, ring + [0, 0, 2]]) + [3, 4, 5]
    exact = n * np.sin(2 * np.pi / n)  # π R² L of the polygon with n corners
    assert_allclose(Enclosure.from_triangles(tube, 2 * n).volume(x), exact, rtol=1e-12)


def test_the_volume_of_quadratic_triangles_takes_their_curved_sides():
    """V = ∫ z dA less the cap over a curved rim: P2 has both paraboloid and cap exactly.

    The cap to the apex c is ∫ z dA = (4 c + ∮ z ds) / 3 over a square whose sides are at 1 of c.
    """
    cloth = fc.Cloth.rectangle(2.0, 2.0, h=1.0, pattern="right", element="P2")
    X, Y = cloth.X.T - 1
    enclosure = Enclosure.from_triangles(cloth.cells, len(X))
    Z = 2 - X**2 - Y**2 / 2
    apex = Z[np.maximum(abs(X), abs(Y)) == 1].mean()  # the mean of the rim's nodes
    sides = 2 * (3 - 2 / 3) + 2 * (2 - 1 / 3)  # ∮ z ds, along X and along Y
    exact = 8 - 4 / 3 - 2 / 3 - (4 * apex + sides) / 3
    assert_allclose(enclosure.volume(np.column_stack([X, Y, Z])), exact, rtol=1e-12)
    elsewhere = np.column_stack([Z, X, Y]) + [3, -1, 2]
    assert_allclose(enclosure.volume(elsewhere), exact, rtol=1e-12)
    system = fc.System(cloth, fc.Fabric(0.2, 100.0), [fc.StVK()], mass="consistent")
    row = Observer.bind(system, system.state(elsewhere), shape=True).row(None, None)
    assert_allclose(row["volume"], exact, rtol=1e-12)


def test_sag_is_the_greatest_fall_since_the_start_also_from_an_arc():
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.5, pattern="right")
    system = fc.System(cloth, fc.Fabric(0.2, 100.0), [fc.StVK()])
    arc = system.rest().x - np.outer(cloth.X[:, 0] * (1 - cloth.X[:, 0]), [0, 0, 1])
    end = system.state(arc - np.outer(0.05 * cloth.X[:, 0], [0, 0, 1]))
    row = Observer.bind(system, system.state(arc)).row_at_rest(end)
    assert_allclose(row["sag"], 0.05)  # of the side at X = 1, where the depth at X = ½ is 0.275
    assert_allclose(-end.x[:, 2].min(), 0.275)


def test_an_observer_records_stretches_and_volume_where_asked():
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.5, pattern="right")
    system = fc.System(cloth, fc.Fabric(0.2, 100.0), [fc.StVK()])
    start = system.state(system.rest().x * [1.5, 0.9, 1])
    row = Observer.bind(system, start, shape=True).row(None, None)
    assert_allclose([row["least_stretch"], row["largest_stretch"]], [0.9, 1.5])
    assert_allclose(row["volume"], 0, atol=1e-15)
    assert "volume" not in Observer.bind(system, start).row(None, None)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("at grip.x = 10 mm", 5.0),
        ("at grip.x = 10 mm after 1.25 mm", 4.0),  # at 8.75 mm
        ("gained from grip.x = 0.005 to 10 mm", 3.0),
        ("gained from grip.x = 5 mm to 10 mm after 1.25 mm", 2.5),
        ("gained from grip.x = 0 mm to 10 mm", 5.0),  # a reaction has no value at the start
        ("at grip.x = 1 mm after 2 mm", 0.0),  # still slack
    ],
)
def test_a_quantity_at_a_place_of_a_grip_with_slack(text, value):
    columns = {
        "grip.x": 0.1 + np.linspace(0.0, 0.01, 5),
        "reaction:grip.x": np.array([np.nan, 1.0, 2.0, 3.0, 5.0]),
    }
    run = RunRecord(np.linspace(0.0, 1.0, 5), columns)
    assert value_of(parse_quantity(f"reaction.grip.x {text}"), run) == pytest.approx(value)
