"""What the sets of contacts keep between positions changes no result; a march goes on with them."""

import numpy as np
import pytest

import fecloth as fc
from fecloth.terms.contact.pairs import nodes_of

pytest.importorskip("ipctk")
GAP = 2e-3
FABRIC = fc.Fabric(0.2, 500.0, 0.3, bending_rigidity=2e-6)


def layers(distance=0.9 * GAP, h=0.02):
    """Two sheets over each other, the upper one turned."""
    sheet = fc.Cloth.rectangle(0.1, 0.1, h)
    cloth = fc.Cloth.join([sheet, fc.Cloth.rectangle(0.09, 0.09, 0.9 * h)], ["lower", "upper"])
    x = np.column_stack([cloth.X, np.zeros(len(cloth.X))])
    over = np.isin(np.arange(len(x)), cloth.nodes("upper"))
    turn = np.array([[0.96, -0.28, 0.0], [0.28, 0.96, 0.0], [0.0, 0.0, 1.0]])
    x[over] = x[over] @ turn.T + [0.02, -0.01, distance]
    return cloth, x, over


def bound(cloth, **options):
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.SelfContact(GAP, **options)])
    return system.bound[-1]


@pytest.mark.parametrize("thickness", [0.0, 5e-4])
def test_kept_pairs_give_the_forces_of_pairs_found_anew(thickness, rng):
    """Positions up to a gap away, and a common motion of all nodes over a metre."""
    cloth, x, over = layers(2.0 * GAP + thickness)
    sets = bound(cloth, thickness=thickness, stiffness=300.0).sets
    kept, counts = sets.candidates(x), []
    for part in np.linspace(0, 0.9, 8):
        way = rng.uniform(-0.05, 0.05, x.shape)
        way[:, 2] -= np.where(over, part, -part)
        y = x + GAP * way + part
        force, counts = sets.force(y), [*counts, len(sets.at(y))]
        assert sets.candidates(y) is kept
        fresh = bound(cloth, thickness=thickness, stiffness=300.0).sets
        expected = fresh.force(y)
        np.testing.assert_allclose(force, expected, rtol=0, atol=1e-12 * abs(expected).max())
        assert sets.energy(y) == pytest.approx(fresh.energy(y), rel=1e-12)
    assert counts[0] == 0 < counts[-1]


def test_pairs_are_found_anew_farther_away():
    cloth, x, over = layers(4 * GAP)
    sets = bound(cloth).sets
    assert not len(sets.at(x))
    assert len(sets.at(x - np.where(over, 3.5 * GAP, 0.0)[:, None] * [0, 0, 1]))


@pytest.mark.parametrize("distance", [0.1, 0.5, 0.9, 1.5, 3.0])
@pytest.mark.parametrize("way", [0.02, 0.2, 1.0, 5.0])
def test_the_free_part_of_a_way_is_free(distance, way, rng):
    """It never takes the whole distance, and is not short without need."""
    cloth, x, over = layers(distance * GAP)
    sets = bound(cloth).sets
    y = x + np.where(over, -way * GAP, 0.0)[:, None] * [0, 0, 1]
    part = sets.free_part(x, y)
    assert part * way < distance
    assert part >= min(1.0, 0.6 * distance / way)


@pytest.mark.parametrize(("aside", "is_kept"), [(0.8, True), (1.25, False)])
@pytest.mark.parametrize("part", [0.0, 0.3, 1.0])
def test_pairs_of_a_way_are_kept_within_a_gap_of_it(part, aside, is_kept, monkeypatch):
    """And not beyond its end; they give the forces of pairs found anew."""
    monkeypatch.setattr("fecloth.terms.contact.toolkit.MOST_PAIRS_PER_NODE", 1000)
    cloth, x, over = layers(4 * GAP)
    sets, way = bound(cloth).sets, np.where(over, -3.5 * GAP, 0.0)[:, None] * [0.0, 0.0, 1.0]
    kept, y = sets.candidates(x, x + way), x + part * way
    expected = bound(cloth).sets.force(y)
    np.testing.assert_allclose(sets.force(y), expected, rtol=0, atol=1e-12 * abs(expected).max())
    assert sets.candidates(y) is kept
    y[3] += aside * GAP * np.array([0.6, 0.8, 0.0])
    y += 0.3 - (y - x - part * way).mean(axis=0)
    assert (sets.candidates(y) is kept) == is_kept
    assert sets.candidates(x + 2.0 * way) is not kept


def test_many_pairs_are_not_kept(monkeypatch):
    cloth, x, _ = layers()
    monkeypatch.setattr("fecloth.terms.contact.toolkit.MOST_PAIRS_PER_NODE", 0)
    sets, usual = bound(cloth).sets, bound(cloth).sets
    assert sets.candidates(x) is None
    monkeypatch.undo()
    np.testing.assert_allclose(sets.force(x), usual.force(x), rtol=0, atol=1e-12)


def test_the_nodes_of_all_kinds_of_pairs_are_those_of_the_toolkit(rng):
    cloth, x, _ = layers(0.7 * GAP)
    sets = bound(cloth).sets
    contacts = sets.at(x + 0.05 * GAP * rng.standard_normal(x.shape))
    kinds = (contacts.vv_collisions, contacts.ev_collisions)
    kinds += contacts.ee_collisions, contacts.fv_collisions
    assert all(len(kind) for kind in kinds)
    edges, faces = sets.mesh.edges, sets.mesh.faces
    expected = [contacts[i].vertex_ids(edges, faces) for i in range(len(contacts))]
    np.testing.assert_array_equal(nodes_of(contacts, sets.mesh), expected)
