"""Units against their definitions, written out here; which keys take them; what is refused."""

import math
import re
import tomllib
from typing import get_args

import pytest
from pydantic import BaseModel

import fecloth as fc
from fecloth.errors import InputError
from fecloth.quantities import units
from fecloth.quantities.units import (
    AREAL,
    HYSTERESIS,
    LENGTH,
    MOMENT,
    PER_ANGLE,
    PER_WIDTH,
    PRESSURE,
    RATE,
    SPEED,
    TIME,
    Dimension,
    is_quantity,
    quantity,
)
from fecloth.scene import type_words
from fecloth.scene.scene import Scene, load_scene
from fecloth.scene.table_model import Made

KILOPOND, INCH, POUND = 9.80665, 0.0254, 0.45359237
FABRIC = (AREAL, PER_WIDTH, PER_ANGLE, MOMENT, HYSTERESIS)
ALL = {name: one for name, one in vars(units).items() if isinstance(one, Dimension)}


@pytest.mark.parametrize(
    ("text", "dimension", "expected"),
    [
        ("150 g/m^2", AREAL, 0.15),
        ("150g/m²", AREAL, 0.15),
        ("20 mg/cm^2", AREAL, 20e-6 / 1e-4),
        ("11 oz/yd^2", AREAL, 11 * POUND / 16 / (36 * INCH) ** 2),
        ("2.5 kN/m", PER_WIDTH, 2500.0),
        (".5 N/mm", PER_WIDTH, 500.0),
        ("500 gf/cm", PER_WIDTH, 0.5 * KILOPOND / 0.01),
        ("1.2e3 N/m", PER_WIDTH, 1200.0),
        ("0.8 gf/(cm·deg)", PER_ANGLE, 0.8e-3 * KILOPOND / 0.01 / math.radians(1)),
        ("9.6 uN*m", MOMENT, 9.6e-6),
        ("9.6 µN·m", MOMENT, 9.6e-6),
        ("9.6 μN m", MOMENT, 9.6e-6),
        ("1 gf*cm^2/cm", MOMENT, 1e-3 * KILOPOND * 0.01**2 / 0.01),
        ("0.03 gf cm/cm", HYSTERESIS, 0.03e-3 * KILOPOND),
        ("3 ft", LENGTH, 36 * INCH),
        ("20 µm", LENGTH, 2e-5),
        ("1.5 h", TIME, 5400.0),
        ("36 km/h", SPEED, 10.0),
        ("1 mph", SPEED, 63360 * INCH / 3600),
        ("5 mbar", PRESSURE, 500.0),
        ("1 psi", PRESSURE, POUND * KILOPOND / INCH**2),
        ("30 1/min", RATE, 0.5),
        ("51/s", RATE, 51.0),
        ("2.5 1/s", RATE, 2.5),
        ("2 L", units.VOLUME, 2e-3),
        ("2 cm³", units.VOLUME, 2e-6),
        ("3 Pa s²/m²", units.DENSITY, 3.0),
        ("1.2 kg/m³", units.DENSITY, 1.2),
        ("2 mN*s/m", units.DAMPER, 2e-3),
        ("-2 gf", units.FORCE, -2e-3 * KILOPOND),
    ],
)
def test_units_are_their_definitions(text, dimension, expected):
    assert quantity("x", text, dimension) == pytest.approx(expected, rel=1e-12)


def test_the_unit_of_bending_is_98_07_micronewton_metres():
    assert quantity("x", "1 gf*cm^2/cm", MOMENT) == pytest.approx(98.07e-6, rel=1e-4)


PARTS = {  # powers of m, kg, s and the value in SI; the degree counts as its value
    **{"m": (1, 0, 0, 1.0), "cm": (1, 0, 0, 1e-2), "mm": (1, 0, 0, 1e-3), "um": (1, 0, 0, 1e-6)},
    **{"km": (1, 0, 0, 1e3), "in": (1, 0, 0, INCH), "ft": (1, 0, 0, 12 * INCH)},
    **{"yd": (1, 0, 0, 36 * INCH), "L": (3, 0, 0, 1e-3), "mL": (3, 0, 0, 1e-6)},
    **{"s": (0, 0, 1, 1.0), "ms": (0, 0, 1, 1e-3), "us": (0, 0, 1, 1e-6)},
    **{"min": (0, 0, 1, 60.0), "h": (0, 0, 1, 3600.0), "mph": (1, 0, -1, 63360 * INCH / 3600)},
    **{"kg": (0, 1, 0, 1.0), "g": (0, 1, 0, 1e-3), "mg": (0, 1, 0, 1e-6)},
    **{"oz": (0, 1, 0, POUND / 16), "deg": (0, 0, 0, math.pi / 180), "1": (0, 0, 0, 1.0)},
    **{"rad": (0, 0, 0, 1.0)},
    **{"N": (1, 1, -2, 1.0), "kN": (1, 1, -2, 1e3), "mN": (1, 1, -2, 1e-3)},
    **{"uN": (1, 1, -2, 1e-6), "gf": (1, 1, -2, 1e-3 * KILOPOND), "kgf": (1, 1, -2, KILOPOND)},
    **{"Pa": (-1, 1, -2, 1.0), "hPa": (-1, 1, -2, 1e2), "kPa": (-1, 1, -2, 1e3)},
    **{"MPa": (-1, 1, -2, 1e6), "mPa": (-1, 1, -2, 1e-3), "bar": (-1, 1, -2, 1e5)},
    **{"mbar": (-1, 1, -2, 1e2), "atm": (-1, 1, -2, 101325.0), "J": (2, 1, -2, 1.0)},
    "psi": (-1, 1, -2, POUND * KILOPOND / INCH**2),
}


def taken_apart(unit):
    """Powers of m, kg, s and value of a product of parts over a product of parts."""
    over, _, under = unit.partition("/")
    powers, value = [0, 0, 0], 1.0
    for text, sign in ((over, 1), (under.strip("()"), -1)):
        for part in filter(None, text.split("*")):
            name, _, power = part.partition("^")
            *dims, size = PARTS[name]
            exponent = sign * int(power or 1)
            powers = [p + exponent * d for p, d in zip(powers, dims, strict=True)]
            value *= size**exponent
    return powers, value


@pytest.mark.parametrize("name", ALL)
def test_derived_units_equal_their_definitions(name):
    """All units of a table measure the same, and each has the value of its parts."""
    same, one = taken_apart(ALL[name].si)
    assert one == 1.0
    for unit, value in ALL[name].units.items():
        powers, expected = taken_apart(unit)
        assert powers == same, unit
        assert value == pytest.approx(expected, rel=1e-14), unit


def test_decimal_factors_leave_no_trace():
    assert quantity("x", "150 g/m^2", AREAL) == 0.15
    assert quantity("x", "0.1 ms", TIME) == 1e-4
    assert quantity("x", "0.12345678901234567 m", LENGTH) == 0.12345678901234567


@pytest.mark.parametrize(
    ("text", "dimension", "remedy"),
    [
        ("150", AREAL, "without a unit is in SI"),
        ("1e3", PER_WIDTH, 'Write it like "1.5 N/m"'),
        ("g/m^2", AREAL, "without a unit"),
        ("150 g/m", AREAL, "Did you mean 'g/m^2'?"),
        ("150 gsm", AREAL, ""),
        ("150 G/m^2", AREAL, "Did you mean"),
        ("9.6 uN/m", MOMENT, "Did you mean 'uN*m'?"),
        ("nan N/m", PER_WIDTH, "without a unit"),
        ("inf N/m", PER_WIDTH, "without a unit"),
        ("1e999 N/m", PER_WIDTH, ""),
        ("1e999999999999999999999 N/m", PER_WIDTH, ""),
        ("1 2 N/m", PER_WIDTH, "without a unit"),
        ("1,5 N/m", PER_WIDTH, ""),
        ("1.2.3 N/m", PER_WIDTH, "without a unit"),
        ("5 N/m + 2 N/m", PER_WIDTH, ""),
        ("5 * t", TIME, "without a unit"),
        ("", AREAL, "without a unit"),
    ],
)
def test_other_text_is_refused(text, dimension, remedy):
    with pytest.raises(InputError) as refused:
        quantity("areal_density", text, dimension)
    assert refused.value.what == f"areal_density = {text!r}"
    assert remedy in refused.value.remedy


@pytest.mark.parametrize("dimension", FABRIC)
def test_a_unit_of_another_quantity_is_refused(dimension):
    """N/m is stiffness, N*m a moment: the slip that costs most."""
    for other in {unit for one in FABRIC for unit in one.units} - set(dimension.units):
        with pytest.raises(InputError, match="one of the units"):
            quantity("x", f"1 {other}", dimension)


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


def tables(model, found):
    """Every table that a scene may hold, by its class's name."""
    found[model.__name__] = model
    for field in model.model_fields.values():
        for part in parts(field.annotation):
            inside = isinstance(part, type) and issubclass(part, BaseModel)
            if inside and part.__name__ not in found:
                tables(part, found)
    return found


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
        said = set().union(*(documented(model.makes, one) for one in (key, *beside)))
        assert said & {unit for unit, value in dimension.units.items() if value == 1}, dimension.si


@pytest.mark.parametrize("name", sorted(set(KEYS) - PLAIN))
def test_every_key_is_read_in_every_unit_of_its_own(name):
    model, key, field = KEYS[name]
    for dimension in type_words.dimensions(field):
        for unit, value in dimension.units.items():
            written = {**dict(dimension.only), key: f"2 {unit}"}
            single = type_words.in_si(written, model.model_fields)[key]
            listed = type_words.in_si(written | {key: (f"2 {unit}",)}, model.model_fields)[key]
            read = [one for one in (single, *listed) if one != f"2 {unit}"]
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
WRITTEN = [  # key in SI, and the same with a unit
    ("width = 1.25", 'width = "125 cm"'),
    ("height = 0.5", 'height = "500mm"'),
    ("h = 0.25", 'h = "0.25 m"'),
    ("areal_density = 0.15", 'areal_density = "150 g/m^2"'),
    ("[2000.0, 900]", '["2 kN/m", 900]'),
    ("shear_stiffness = 60", 'shear_stiffness = "60 N/m"'),
    ("9.6e-6", '"9.6 uN m"'),
    ("time = 0.002", 'time = "2 ms"'),
    ("k = 250", 'k = "2.5 N/cm"'),
    ("-9.81]", '"-981 cm/s^2"]'),
    ("pressure = 500", 'pressure = "5 mbar"'),
    ("[5, ", '["18 km/h", '),
    ("normal = 0.7", 'normal = "700 g/m³"'),
    ("gust_length = 0.5", 'gust_length = "50 cm"'),
    ("[1.25, 0.25, ", '["125 cm", "0.25 m", '),
    ("stiffness = 20\n", 'stiffness = "0.2 N/cm"\n'),
    ("damping = 0.002", 'damping = "2 g/s"'),
    ("where = [0.25, ", 'where = ["250 mm", '),
    ("force = [0, 0.1,", 'force = [0, "100 mN",'),
    ("rate = 0.5", 'rate = "30 1/min"'),
    ("0.001]", '"1 mN"]'),
    ("[0.01, 0, 1]", '["1 cm", 0, "0.001 km"]'),
    ("dt = 0.005", 'dt = "5 ms"'),
    ("t_end = 90", 't_end = "1.5 min"'),
    (" every = 0.02", ' every = "20 ms"'),
    ("restart_every = 1.5", 'restart_every = "1.5 s"'),
    ("point = [0.5, ", 'point = ["50 cm", '),
    ("at = 0.1", 'at = "100 ms"'),
]


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "si.toml"
    path.write_text(SI)
    return path


def test_a_scene_in_units_is_the_scene_in_si_bit_for_bit(file):
    text = SI
    for plain, quoted in WRITTEN:
        assert text.count(plain) == 1, plain
        text = text.replace(plain, quoted)
    other = file.with_name("units.toml")
    other.write_text(text, encoding="utf-8")
    plain, quoted = load_scene(file), load_scene(other)
    assert quoted == plain
    assert quoted.to_toml() == plain.to_toml()  # and so runs the same
    resolved = tomllib.loads(quoted.to_toml())
    assert (resolved["time"]["dt"], resolved["terms"][4]["velocity"][0]) == (0.005, 5.0)
    again = file.with_name("again.toml")
    again.write_text(quoted.to_toml(), encoding="utf-8")
    assert load_scene(again) == plain


def test_units_on_the_command_line(file):
    """A shell takes the quotes of --set time.dt="5 ms" away."""
    for override in ("time.dt=5 ms", 'time.dt="5 ms"', "time.dt=5ms", "time.dt=0.005"):
        assert load_scene(file, [override]).time.dt == 0.005
    assert load_scene(file, ["start.shift=['1 cm', 0, 0]"]).start.shift == (0.01, 0.0, 0.0)
    assert load_scene(file, ["terms.3.pressure=2 kPa"]).terms[3].pressure == 2000.0


REFUSED = [
    ("time.dt=5 m", "time.dt = '5 m': must be a number with one of the units s, ms, us, min, h"),
    ("time.t_end='x'", "time.t_end = 'x': must be a number with one of the units s, ms"),
    ("time.dt='often'", "time.dt = 'often': must be a finite number > 0 or 'auto' [s]"),
    ("time.dt=-5 ms", "time.dt = -0.005: must be a finite number > 0 or 'auto' [s]"),
    ("cloth.h=5 g", "cloth.h = '5 g': must be a number with one of the units m, cm, mm"),
    ("start.shift=['1 s', 0, 0]", "start.shift = '1 s': must be a number with one of the units m"),
    ("start.shift=5 m", "start.shift = '5 m': must be a list of 3 finite numbers [m]"),
    ("terms.1.law.k=5 N", "terms.1.law.k = '5 N': must be a number with one of the units N/m"),
    (
        "terms.3.pressure=5 N",
        "terms.3.pressure = '5 N': must be a number with one of the units Pa",
    ),
    ("terms.3.pressure=5 t", "psi, N/m^2, kN/m^2, or a formula"),
    ("terms.4.normal=1 Pa*s/m", "terms.4.normal = '1 Pa*s/m': must be a number with one of"),
    ("terms.8.force=['1 Pa', 0, 0]", "terms.8.force = '1 Pa': must be a number with one of"),
    ("start.velocity=['5 m/s', '0', '0']", "smoothstep. A formula is in SI and has no units."),
    ("expect.area.at=5 m", "expect.area.at = '5 m': must be a number with one of the units s, ms"),
    ("expect.area.value='1 m^2'", "value = '1 m^2': must be a finite number"),
    ("start.rotate.degrees=5 deg", "start.rotate.degrees = '5 deg': must be a finite number"),
    ("fabric.poisson_ratio='0.3'", "fabric.poisson_ratio = '0.3': must be a finite number"),
]


@pytest.mark.parametrize(("override", "message"), REFUSED, ids=[case[0] for case in REFUSED])
def test_a_unit_of_the_wrong_kind_is_refused_with_those_allowed(file, override, message):
    with pytest.raises(fc.SceneError) as refused:
        load_scene(file, [override])
    assert message in str(refused.value)


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
    with pytest.raises(fc.SceneError, match=r"stretch = '1 N/m': must be .* N/m\^3"):
        load_scene(file, [table.replace("['1 N/cm^3'", "['1 N/m'")])


def test_the_name_of_a_set_is_no_quantity(file):
    force = "terms.6={type='PointForce', where='5 m', force=[0, 0, 1]}"
    assert load_scene(file, [force]).terms[6].where == "5 m"


def test_message_of_a_missing_key_states_its_unit(file):
    with pytest.raises(
        fc.SceneError, match=r"time.t_end is missing: must be a finite number \[s\]"
    ):
        load_scene(file, ["time={method='bdf2'}"])


# --- Python ---------------------------------------------------------------------------------------

IN_PYTHON = [
    (lambda: fc.Fabric("150 g/m²", ("20 N/cm", 900), shear_stiffness="0.06 kN/m"),
     fc.Fabric(0.15, (2000.0, 900), shear_stiffness=60.0)),
    (lambda: fc.Gravity((0, 0, "-981 cm/s^2")), fc.Gravity((0, 0, -9.81))),
    (lambda: fc.Gravity(acceleration=(0, 0, "-9.81 m/s^2")), fc.Gravity((0, 0, -9.81))),
    (lambda: fc.Pressure("5 mbar"), fc.Pressure(500.0)),
    (lambda: fc.Pressure("5 * t"), fc.Pressure("5 * t")),
    (lambda: fc.Wind(["18 km/h", "0.1 * t", 0], normal="0.7 g/L", gust_length="50 cm"),
     fc.Wind([5.0, "0.1 * t", 0], normal=0.7, gust_length=0.5)),
    (lambda: fc.Drag("2 Pa s/m", law="linear"), fc.Drag(2.0, law="linear")),
    (lambda: fc.PointForce(("25 cm", "0.5 m"), ("1 gf", 0, "t")),
     fc.PointForce((0.25, 0.5), (9.80665e-3, 0, "t"))),
    (lambda: fc.EdgeForce("left", ("2 gf/cm", 0, "t")),
     fc.EdgeForce("left", (1.96133, 0, "t"))),
    (lambda: fc.EdgeForce("left", normal="3 kN/m"), fc.EdgeForce("left", normal=3000.0)),
    (lambda: fc.PointForce("left", (0, 0, 1)), fc.PointForce("left", (0, 0, 1))),
    (lambda: fc.PointForce([1, 2], (0, 0, "1 N")), fc.PointForce([1, 2], (0, 0, 1.0))),
    (lambda: fc.UserForce((0, 0, "2 mN"), per="node"), fc.UserForce((0, 0, 0.002), per="node")),
    (lambda: fc.StrainRateDamping("2 ms", fc.TensorCondition("2.5 N/cm")),
     fc.StrainRateDamping(0.002, fc.TensorCondition(250.0))),
]  # fmt: skip


@pytest.mark.parametrize(("written", "expected"), IN_PYTHON)
def test_python_reads_the_units_of_scenes(written, expected):
    assert written() == expected
