"""Loose folds come to rest on each other: equilibria of a strip with `SelfContact`."""

import numpy as np
import pytest

import fecloth as fc
from fecloth.mesh.surface import find_intersections

pytest.importorskip("ipctk")
GAP, LENGTH, ANGLE = 1e-3, 0.05, 0.15


def folded(folds, friction=0.0, has_floor=True):
    """A strip in sharp loose folds, held at its lower end; its start."""
    cloth = fc.Cloth.rectangle(folds * LENGTH, 0.04, 0.0125)
    number = np.minimum((cloth.X[:, 0] / LENGTH).astype(int), folds - 1)
    way = cloth.X[:, 0] - number * LENGTH
    across = np.where(number % 2, LENGTH - way, way) * np.cos(ANGLE)
    height = (number * LENGTH + way) * np.sin(ANGLE) + 2 * GAP
    contacts = [fc.SelfContact(GAP, friction)]
    if has_floor:
        contacts.append(fc.Obstacle(fc.shapes.Plane((0, 0, 0), (0, 0, 1)), GAP, friction))
    fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity(), *contacts]
    system = fc.System(cloth, fabric, terms, ["left"])
    return system, system.state(np.column_stack([across, cloth.X[:, 1], height]))


@pytest.mark.stories
@pytest.mark.parametrize(
    ("folds", "friction", "has_floor", "load_steps"),
    [(4, 0.0, True, None), (4, 0.0, False, None), (4, 0.3, True, 5)],
)
def test_loose_folds_come_to_rest(folds, friction, has_floor, load_steps):
    system, start = folded(folds, friction, has_floor)
    end = fc.equilibrium(system, start, load_steps=load_steps)
    assert end.residual <= (1e-6 if friction else 1e-9)
    assert len(find_intersections(system.cloth.triangles, end.x)) == 0
    assert all(term.allows(end.x, 0.0) for term in system.bound)
    if not friction:  # the floor and the end that is held carry the weight
        f = system.force(end)
        free = np.setdiff1d(np.arange(len(f)), system.constraints.nodes)
        weight = 9.81 * system.nodal_mass.sum()
        assert np.linalg.norm(f[free], axis=1).max() < 1e-6 * weight
    fallen = start.x[:, 2].max() - end.x[:, 2].max()
    assert fallen > 0.2 * folds * LENGTH * np.sin(ANGLE)


@pytest.mark.stories
def test_a_search_that_contact_cuts_short_does_not_blame_slack_triangles():
    system, start = folded(4)
    with pytest.raises(fc.EquilibriumFailed, match="did not converge in 8 iterations") as caught:
        fc.equilibrium(system, start, max_iterations=8)
    assert "slack" not in str(caught.value)
