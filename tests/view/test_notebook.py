"""What a notebook shows: one line for each object, figures for a result."""

import re
from dataclasses import replace

import pytest

import fecloth as fc


@pytest.fixture(scope="module")
def result():
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.25, pattern="right")
    fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0)
    system = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity()], pins=["left"])
    probes = [fc.Probe("tip <1>", "right")]
    return system, fc.run(system, fc.BDF2(), system.rest(), 0.01, 0.1, probes=probes)


def test_repr_is_one_line(result):
    system, ended = result
    sets = ", ".join(sorted(system.cloth.node_sets))
    lines = {
        f"<Cloth of 15 nodes, 16 P1 triangles, 0.5 m²; node sets: {sets}>": system.cloth,
        "<System of 15 nodes, 3 held: StVK, Gravity>": system,
        "<State of 15 nodes at t = 0.1 s>": ended.state,
        "<Result of 10 steps of BDF2() to t = 0.1 s, "
        f"error in time at most {100 * ended.time_error:.2g} % of the motion>": ended,
    }
    for line, each in lines.items():
        assert repr(each) == line


def test_a_result_is_figures_of_energies_and_probes(result):
    page = result[1]._repr_html_()
    assert page.count("<figure>") == 2
    names = re.findall(r"</i>(.*?)</span>", page)
    assert {"kinetic", "StVK", "Gravity", "sag", "tip &lt;1&gt;.z"} <= set(names)
    assert not any("reaction" in name for name in names)
    assert "nan" not in page


def test_repr_counts_the_warnings(result):
    doubt = fc.Doubt(fc.DoubtKind.OTHER, "off by 1 J")
    assert ", 1 warning>" in repr(replace(result[1], doubts=(doubt,)))
