"""Pins that let go in a run: momentum, the free flight after it, restarts, derivatives."""

import numpy as np
import pytest
from support.rundirs import written

import fecloth as fc
from fecloth.output.vtu_writer import read_vtu
from fecloth.runs.run_scene import run_scene
from fecloth.scene.scene import load_scene

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

TIGHT = fc.Newton(tolerance=1e-12)
FABRIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-4)
UNTIL = 0.04
METHODS = [fc.ImplicitMidpoint(), fc.BDF2(), fc.GeneralizedAlpha(), fc.CentralDifference()]


def make(pins, terms=(), cloth=None):
    cloth = cloth or fc.Cloth.rectangle(0.4, 0.3, 0.15)
    return fc.System(cloth, FABRIC, [fc.StVK(), *terms], pins)


def states_of(system, method, start=None, dt=1e-3, t_end=0.1, **more):
    start = start or system.rest()
    states = {}
    for state, info in fc.march(system, method, start, dt, t_end, newton=TIGHT, **more):
        states[round(state.t, 9)] = state, info
    return states


@pytest.mark.parametrize("method", METHODS, ids=lambda method: type(method).__name__)
def test_it_is_a_run_to_the_release_and_a_run_from_there(method):
    """To the last bit: projectors, matrix and method begin anew, with x and v."""
    pins = [
        fc.Pin(lambda X: X[:, 0] < 1e-9, until=UNTIL),
        fc.Slide("right", normal=(1, 0, 1), until=0.06),
        fc.Pin(lambda X: X[:, 1] > 0.29, without=lambda X: (X[:, 0] < 0.01) | (X[:, 0] > 0.39)),
    ]
    system = make(pins, [fc.Gravity(), fc.PlateBending()])
    states = states_of(system, method, solver="direct")
    state = system.rest()
    for left, end in ((pins, UNTIL), (pins[1:], 0.06), (pins[2:], 0.1)):
        part = system.replace(pins=left)
        state = states_of(part, method, state, t_end=end, solver="direct")[end][0]
        here = states[end][0]
        np.testing.assert_allclose(here.x, state.x, rtol=0, atol=1e-12)
        np.testing.assert_allclose(here.v, state.v, rtol=0, atol=1e-9)
    assert abs(states[0.1][0].x - states[0.06][0].x).max() > 1e-3


def test_pins_of_one_edge_that_let_go_one_after_another():
    """The corner is held as long as one of its pins holds it."""
    system = make([fc.Pin("left", until=0.02), fc.Pin("top", until=UNTIL)], [fc.Gravity()])
    assert system.releases == (0.02, UNTIL)
    corner = np.intersect1d(system.cloth.nodes("left"), system.cloth.nodes("top"))
    states = states_of(system, fc.ImplicitMidpoint())
    assert not states[UNTIL][0].v[corner].any()
    assert states[0.1][0].v[corner, 2] < -0.1
    assert list(system.after(0.02).constraints.groups) == ["top"]
    assert system.after(0.03) is system.after(0.02)
    assert system.after(0.01) is system
    assert not len(system.after(1.0).constraints.nodes)


def test_rows_of_a_run():
    """The reaction is zero after the release, and the energies balance."""
    pins = [fc.Pin("left", name="grip", until=UNTIL), fc.Pin("right", ("0", "0", "0.2 * t"))]
    system = make(pins, [fc.Gravity()])
    result = fc.run(system, fc.ImplicitMidpoint(), system.rest(), 1e-3, 0.1, newton=TIGHT)
    held = result.times <= UNTIL
    reaction = result.observed["reaction:grip.z"]
    assert not reaction[~held].any()
    assert reaction[np.flatnonzero(held)[-1]] > 0.01
    assert result.observed["reaction:right.z"][-1] > 0.01
    energies = result.energies
    assert abs(energies["remainder"]).max() < 1e-3 * energies["kinetic"].max()


def test_a_clamp_that_lets_go_frees_the_normals():
    cloth = fc.Cloth.rectangle(0.4, 0.1, 0.05)
    pins = [fc.Pin("left", clamp=True, until=UNTIL), fc.Pin("left")]
    system = make(pins, [fc.Gravity(), fc.PlateBending()], cloth)
    after = system.after(UNTIL)
    assert system.panel.clamps
    assert not after.panel.clamps
    assert after.constraints.nodes.tolist() == system.constraints.nodes.tolist()
    assert after.layout is system.layout
    result = fc.run(system, fc.ImplicitMidpoint(), system.rest(), 1e-3, 0.1, newton=TIGHT)
    energies = result.energies
    assert abs(energies["remainder"]).max() < 2e-3 * energies["kinetic"].max()


@pytest.mark.parametrize("rows", [10, 10**6])
def test_fused_steps_begin_anew(rows):
    pins = [fc.Pin("left", ("0", "0", "t"), until=UNTIL), fc.Pin("right")]
    system = make(pins, [fc.Gravity()])
    result = fc.run(system, fc.CentralDifference(), system.rest(), 2e-4, 0.1, rows=rows)
    single = states_of(system, fc.CentralDifference(), dt=2e-4)
    assert UNTIL in result.times
    np.testing.assert_allclose(result.state.x, single[0.1][0].x, rtol=0, atol=1e-12)
    assert result.steps == 500
    assert (len(result.times) < 300) == (rows == 10)


def test_chosen_steps_end_at_the_release():
    system = make([fc.Pin("left", until=UNTIL)], [fc.Gravity()])
    for method in (fc.Adaptive(fc.BDF2()), fc.Auto(), fc.CentralDifference()):
        times = [state.t for state, _ in fc.march(system, method, system.rest(), None, 0.1)]
        assert UNTIL in times


@pytest.mark.parametrize(
    "method", [fc.ImplicitMidpoint(), fc.BDF2(), fc.CentralDifference()], ids=lambda m: str(m)[:9]
)
def test_derivatives_cross_it(method):
    answer = derivatives(method, ["speed", "density"], ["edge.z", "reaction.right.z", "pins"])
    assert abs(answer.derivative[1]).min() > 1e-6
    assert (answer.checked < 1e-3).all()


def derivatives(method, parameters, quantities):
    """Of a sheet whose left edge is let go while the right one moves."""

    def let_go(h, density=0.2, speed=0.3, until=0.02):
        pins = [fc.Pin("left", until=until), fc.Pin("right", ("0", "0", f"{speed!r} * t"))]
        cloth, fabric = fc.Cloth.rectangle(0.4, 0.3, h), fc.Fabric(density, 1000.0, 0.3)
        system = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity()], pins)
        return cloth, system, method, system.rest()

    dt, probes = 5e-4 if method.traits.explicit else 2e-3, [fc.Probe("edge", "left")]
    return fc.sensitivity(let_go, parameters, quantities, h=0.15, dt=dt, t_end=0.05, probes=probes)


def test_the_time_of_a_release_has_no_derivative():
    answer = derivatives(fc.BDF2(), ["until"], "edge.z")
    assert np.isnan(answer.derivative).all()
    assert "until changes when a pin lets go" in answer.verdict


def test_an_equilibrium_has_the_pins_of_its_time():
    system = make([fc.Pin("left", until=UNTIL), fc.Pin("right")], [fc.Gravity((1.0, 0, 0))])
    held = fc.equilibrium(system, system.rest())
    free = fc.equilibrium(system, system.state(system.rest().x, t=1.0))
    left = system.cloth.nodes("left")
    assert np.array_equal(held.x[left], system.rest().x[left])
    assert (abs(free.x[left, 0] - system.rest().x[left, 0]) > 1e-5).all()


SCENE = """
cloth = { shape = "rectangle", width = 0.4, height = 0.3, h = 0.15 }
fabric = { areal_density = 0.2, tensile_stiffness = 300.0, bending_rigidity = 1e-5 }
terms = [{ type = "StVK" }, { type = "PlateBending" }, { type = "Gravity" }]
pins = [
  { where = "left", clamp = true, until = "60 ms" },
  { where = "right", until = "90 ms" },
  { where = "top", without = "corners", motion = ["0", "0", "0.1 * t"] },
]
time = { method = "bdf2", dt = 0.01, t_end = 0.12 }
output = { every = 0.02, restart_steps = 3 }
"""


@pytest.mark.parametrize("last", [5, 7, 11])  # it goes on from the steps 3, 6 and 9
def test_a_scene_goes_on_bit_for_bit(last, tmp_path):
    file = tmp_path / "let_go.toml"
    file.write_text(SCENE)

    def stop(info):
        if info.step == last:
            raise KeyboardInterrupt

    run_scene(load_scene(file), tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        run_scene(load_scene(file), tmp_path / "broken", report=stop)
    assert run_scene(load_scene(file), tmp_path / "broken", resume=True).status == "done"
    assert written(tmp_path / "broken") == written(tmp_path / "whole")
    frames = sorted((tmp_path / "whole" / "frames").iterdir())
    held = [np.count_nonzero(read_vtu(frame).point_data["held"]) for frame in frames]
    assert held[0] == held[2] > held[3] == held[4] > held[5]  # at 60 and 90 ms
