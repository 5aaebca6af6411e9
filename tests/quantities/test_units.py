"""Units against their definitions, written out here; which keys take them; what is refused."""

import math
import re
from typing import get_args

import pytest
from pydantic import BaseModel

import fecloth as fc
from fecloth.quantities import units
from fecloth.quantities.units import (
    AREAL,
    HYSTERESIS,
    LENGTH,
    MOMENT,
    PER_ANGLE,
    PER_WIDTH,
    RATE,
    TIME,
    Dimension,
    is_quantity,
    quantity,
)
from fecloth.scene import type_words
from fecloth.scene.scene import Scene, load_scene
from fecloth.scene.table_model import Made

KILOPOND, INCH, POUND = 9.80665, 0.0254, 0.45359237
ALL = {name: each for name, each in vars(units).items() if isinstance(each, Dimension)}


@pytest.mark.parametrize(
    ("text", "dimension", "expected"),
    [
        ("150g/m²", AREAL, 0.15),
        (".5 N/mm", PER_WIDTH, 500.0),
        ("1.2e3 N/m", PER_WIDTH, 1200.0),
        ("0.8 gf/(cm·deg)", PER_ANGLE, 0.8e-3 * KILOPOND / 0.01 / math.radians(1)),
        ("9.6 µN·m", MOMENT, 9.6e-6),
        ("9.6 μN m", MOMENT, 9.6e-6),
        ("1 gf*cm^2/cm", MOMENT, 1e-3 * KILOPOND * 0.01**2 / 0.01),
        ("0.03 gf cm/cm", HYSTERESIS, 0.03e-3 * KILOPOND),
        ("20 µm", LENGTH, 2e-5),
        ("30 1/min", RATE, 0.5),
        ("51/s", RATE, 51.0),
        ("2 cm³", units.VOLUME, 2e-6),
        ("3 Pa s²/m²", units.DENSITY, 3.0),
        ("-2 gf", units.FORCE, -2e-3 * KILOPOND),
    ],
)
def test_units_may_be_spelt_in_several_ways(text, dimension, expected):
    assert quantity("x", text, dimension) == pytest.approx(expected, rel=1e-12)


PARTS = {  # the values in SI of units with the same powers of m, kg and s
    (0, 0, 0): {"1": 1.0, "rad": 1.0, "deg": math.pi / 180},  # the degree counts as its value
    (1, 0, 0): {
        **{"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "km": 1e3},
        **{"in": INCH, "ft": 12 * INCH, "yd": 36 * INCH},
    },
    (3, 0, 0): {"L": 1e-3, "mL": 1e-6},
    (0, 0, 1): {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0},
    (1, 0, -1): {"mph": 63360 * INCH / 3600},
    (0, 1, 0): {"kg": 1.0, "g": 1e-3, "mg": 1e-6, "oz": POUND / 16},
    (1, 1, -2): {
        **{"N": 1.0, "kN": 1e3, "mN": 1e-3, "uN": 1e-6},
        **{"gf": 1e-3 * KILOPOND, "kgf": KILOPOND},
    },
    (-1, 1, -2): {
        **{"Pa": 1.0, "hPa": 1e2, "kPa": 1e3, "MPa": 1e6, "mPa": 1e-3, "bar": 1e5},
        **{"mbar": 1e2, "atm": 101325.0, "psi": POUND * KILOPOND / INCH**2},
    },
    (2, 1, -2): {"J": 1.0},
}
SIZES = {name: (*powers, size) for powers, of in PARTS.items() for name, size in of.items()}


def taken_apart(unit):
    """Powers of m, kg, s and value of a product of parts over a product of parts."""
    over, _, under = unit.partition("/")
    powers, value = [0, 0, 0], 1.0
    for text, sign in ((over, 1), (under.strip("()"), -1)):
        for part in filter(None, text.split("*")):
            name, _, power = part.partition("^")
            *dims, size = SIZES[name]
            exponent = sign * int(power or 1)
            powers = [p + exponent * d for p, d in zip(powers, dims, strict=True)]
            value *= size**exponent
    return powers, value


@pytest.mark.parametrize("name", ALL)
def test_derived_units_equal_their_definitions(name):
    """All units of a table measure the same, and factor has the value of its parts."""
    same, factor = taken_apart(ALL[name].si)
    assert factor == 1.0
    for unit, value in ALL[name].units.items():
        powers, expected = taken_apart(unit)
        assert powers == same, unit
        assert value == pytest.approx(expected, rel=1e-14), unit


def test_decimal_factors_leave_no_trace():
    assert quantity("x", "150 g/m^2", AREAL) == 0.15
    assert quantity("x", "0.1 ms", TIME) == 1e-4
    assert quantity("x", "0.12345678901234567 m", LENGTH) == 0.12345678901234567


@pytest.mark.parametrize(
    "formula", ["1e3", "2.5", "5*t", "5 * t", "5/t", "-1", "3-t", "t", "0.1 * sin(t)", "", ".5e-3"]
)
def test_a_formula_is_no_quantity(formula):
    assert not is_quantity(formula)


# --- the keys of a scene --------------------------------------------------------------------------

PLAIN = {  # numbers without a unit
    *("MeshFile.scale", "MeshFilePiece.scale"),
    *("ObstacleTable.friction", "ObstacleTable.restitution"),
    *("MeshObstacleTable.friction", "MeshObstacleTable.restitution", "MeshObstacleTable.scale"),
    *("SelfContactTable.friction", "SelfContactTable.restitution"),
    *("FabricTable.poisson_ratio", "FabricTable.bending_poisson_ratio"),
    *("WindTable.gusts", "GasTable.exponent", "GradingTable.power"),
    *("BaraffWitkinTable.rest", "BaraffWitkinTable.area_exponent"),
    *("SolverTable.tolerance", "SolverTable.forcing", "EquilibriumTable.tolerance"),
    *("MembraneTableTable.warp", "MembraneTableTable.weft", "MembraneTableTable.shear"),
    *("MembraneTableTable.poisson", "GeneralizedAlphaTable.rho_inf"),
    *("NewmarkTable.beta", "NewmarkTable.gamma"),
    *("HingeBendingTable.rest", "PlateBendingTable.rest", "BendingFrictionTable.stiffness"),
    *("Scene.grain_degrees", "Rotation.degrees"),  # rad; degrees
    *("Rotation.axis", "RotationTable.axis", "PinTable.direction", "PinTable.normal"),
    *("PlaneTable.normal", "CylinderTable.axis", "DiskTable.normal"),
    # in the unit of what is expected, which is a column of the run
    *("Expectation.value", "Expectation.relative", "Expectation.absolute"),
}


def parts(hint):
    """A type and all types in it."""
    return [hint, *(part for arg in get_args(hint) for part in parts(arg))]


def tables(model, result):
    """Every table that a scene may hold, by its class's name."""
    result[model.__name__] = model
    for field in model.model_fields.values():
        for part in parts(field.annotation):
            inside = isinstance(part, type) and issubclass(part, BaseModel)
            if inside and part.__name__ not in result:
                tables(part, result)
    return result


TABLES = tables(Scene, {})
KEYS = {
    f"{name}.{key}": (model, key, field)
    for name, model in TABLES.items()
    for key, field in model.model_fields.items()
    if float in parts(field.annotation)
}


def test_every_number_of_a_scene_has_its_units_or_is_listed_as_plain():
    assert len(KEYS) > 50
    without = {name for name, (_, _, field) in KEYS.items() if not type_words.dimensions(field)}
    assert without == PLAIN


def documented(cls, key):
    """The units in square brackets that a class's docstring has for a parameter."""
    entry = rf"^    (?:\w+, )*{key}(?:, \w+)*\n((?:        .*\n|\n)+)"
    docs = [f"{base.__doc__}\n" for base in cls.__mro__]  # `Shape` says how all shapes move
    text = next(text[1] for doc in docs if (text := re.search(entry, doc, re.MULTILINE)))
    spelt = str.maketrans({"²": "^2", "³": "^3", " ": "*"})
    inside = ", ".join(re.findall(r"\[(.*?)\]", text))
    return {unit.translate(spelt) for unit in re.split(r", |; | or | for ", inside)}


OF_OBJECTS = sorted(name for name in set(KEYS) - PLAIN if issubclass(KEYS[name][0], Made))


@pytest.mark.parametrize("name", OF_OBJECTS)
def test_the_docstring_of_the_object_names_the_unit_of_the_key(name):
    model, key, field = KEYS[name]
    for dimension in type_words.dimensions(field):
        beside = [other for other, _ in dimension.only]  # UserForce says it where it explains `per`
        said = set().union(*(documented(model.makes, each) for each in (key, *beside)))
        assert said & {unit for unit, value in dimension.units.items() if value == 1}, dimension.si


@pytest.mark.parametrize("name", sorted(set(KEYS) - PLAIN))
def test_every_key_is_read_in_every_unit_of_its_own(name):
    model, key, field = KEYS[name]
    for dimension in type_words.dimensions(field):
        for unit, value in dimension.units.items():
            written = {**dict(dimension.only), key: f"2 {unit}"}
            single = type_words.in_si(written, model.model_fields)[key]
            listed = type_words.in_si(written | {key: (f"2 {unit}",)}, model.model_fields)[key]
            read = [each for each in (single, *listed) if each != f"2 {unit}"]
            assert read
            assert read == pytest.approx([2 * value] * len(read))


# --- scenes ---------------------------------------------------------------------------------------

SI = """
cloth = { shape = "rectangle", width = 1.25, height = 0.5, h = 0.25, pattern = "right" }
pins = [{ where = "left", motion = [0, 0, "0.1 * t"] }]
time = { method = "bdf2", dt = 0.005, t_end = 90 }
output = { every = 0.02, restart_every = 1.5 }
probes = [{ name = "middle", point = [0.5, 0.25] }]
expect = { area = { value = 1.0, relative = 0.02, at = 0.1 } }
[fabric]
areal_density = 0.15
tensile_stiffness = [2000.0, 900]
shear_stiffness = 60
bending_rigidity = 9.6e-6
[[terms]]
type = "StVK"
[[terms]]
type = "StrainRateDamping"
time = 0.002
law = { type = "TensorCondition", k = 250 }
[[terms]]
type = "Gravity"
acceleration = [0, 0, -9.81]
[[terms]]
type = "Pressure"
pressure = 500
[[terms]]
type = "Wind"
velocity = [5, "0.1 * t", 0]
normal = 0.7
gust_length = 0.5
[[terms]]
type = "Tether"
where = "right"
point = [1.25, 0.25, "0.01 * t"]
stiffness = 20
damping = 0.002
[[terms]]
type = "PointForce"
where = [0.25, 0.5]
force = [0, 0.1, "1e-3*t"]
[[terms]]
type = "MassDamping"
rate = 0.5
[[terms]]
type = "UserForce"
force = [0, 0, 0.001]
per = "node"
[start]
rotate = { axis = [0, 0, 1], degrees = 10 }
shift = [0.01, 0, 1]
velocity = ["0", "0", "0.1"]
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "si.toml"
    path.write_text(SI)
    return path


def test_units_on_the_command_line(file):
    """A shell takes the quotes of --set time.dt="5 ms" away."""
    for override in ("time.dt=5 ms", 'time.dt="5 ms"', "time.dt=5ms", "time.dt=0.005"):
        assert load_scene(file, [override]).time.dt == 0.005
    assert load_scene(file, ["start.shift=['1 cm', 0, 0]"]).start.shift == (0.01, 0.0, 0.0)
    assert load_scene(file, ["terms.3.pressure=2 kPa"]).terms[3].pressure == 2000.0


def test_unit_of_a_drag_coefficient_depends_on_its_law(file):
    drag = "terms.4={type='Drag', law='linear', normal='5 mPa*s/m'}"
    assert load_scene(file, [drag]).terms[4].normal == 0.005
    assert (
        load_scene(file, ["terms.8.per=area", "terms.8.force=['1 Pa', 0, 0]"]).terms[8].force[0]
        == 1
    )
    published = "type='BaraffWitkin', area_exponent=1, shear='1 N/cm^3'"
    table = f"terms.0={{{published}, stretch=['1 N/cm^3', '2 N/cm^3']}}"
    assert load_scene(file, [table]).terms[0].stretch == (1e6, 2e6)


def test_the_name_of_a_set_is_no_quantity(file):
    force = "terms.6={type='PointForce', where='5 m', force=[0, 0, 1]}"
    assert load_scene(file, [force]).terms[6].where == "5 m"


# --- Python ---------------------------------------------------------------------------------------

IN_PYTHON = [
    (lambda: fc.Fabric("150 g/m²", ("20 N/cm", 900), shear_stiffness="0.06 kN/m"),
     fc.Fabric(0.15, (2000.0, 900), shear_stiffness=60.0)),
    (lambda: fc.Gravity((0, 0, "-981 cm/s^2")), fc.Gravity((0, 0, -9.81))),
    (lambda: fc.Pressure("5 mbar"), fc.Pressure(500.0)),
    (lambda: fc.Pressure("5 * t"), fc.Pressure("5 * t")),
    (lambda: fc.Wind(["18 km/h", "0.1 * t", 0], normal="0.7 g/L", gust_length="50 cm"),
     fc.Wind([5.0, "0.1 * t", 0], normal=0.7, gust_length=0.5)),
    (lambda: fc.Drag("2 Pa s/m", law="linear"), fc.Drag(2.0, law="linear")),
    (lambda: fc.PointForce(("25 cm", "0.5 m"), ("1 gf", 0, "t")),
     fc.PointForce((0.25, 0.5), (9.80665e-3, 0, "t"))),
    (lambda: fc.StrainRateDamping("2 ms", fc.TensorCondition("2.5 N/cm")),
     fc.StrainRateDamping(0.002, fc.TensorCondition(250.0))),
]  # fmt: skip


@pytest.mark.parametrize(("written", "expected"), IN_PYTHON)
def test_python_reads_the_units_of_scenes(written, expected):
    assert written() == expected
