"""Strips as problems of studies: hung by an edge, stretched between grips, and their files."""

import pytest

import fecloth as fc

TIP = [fc.Probe("tip", "right")]


def strip(h, stiffness=20.0, nu=0.0, pattern="right", element="P1"):
    """A strip that hangs in its plane from its left edge, to come to rest."""
    cloth = fc.Cloth.rectangle(1.0, 0.25, h, pattern=pattern, element=element)
    terms, mass = [fc.StVK(), fc.Gravity((9.81, 0, 0))], {"P1": "lumped", "P2": "consistent"}
    fabric = fc.Fabric(0.2, stiffness, nu)
    system = fc.System(cloth, fabric, terms, pins=["left"], mass=mass[element])
    return cloth, system, None, system.rest()


def moving_strip(h, dt, stiffness=200.0):
    """The strip, as its weight begins to stretch it."""
    cloth, system, _, start = strip(h, stiffness)
    return cloth, system, fc.BDF2(), start


def gripped(h, stiffness=1000.0, density=0.2, drawn=0.02, length=1.0, B=1e-5):
    """A strip between two grips; its nodes move with the length."""
    plain = fc.Cloth.rectangle(1.0, 0.5, h, pattern="right")
    cloth = fc.Cloth.from_arrays(
        plain.X * [length, 1.0], plain.triangles, sets=dict(plain.node_sets)
    )
    fabric = fc.Fabric(density, stiffness, 0.0, bending_rigidity=B)
    system = fc.System(cloth, fabric, [fc.StVK()], ["left", "right"])
    x = system.rest().x * [1.0 + drawn, 1.0, 1.0]
    return cloth, system, None, system.state(x)


def grip_force(stiffness=1000.0, drawn=0.02):
    """F = Y W s (s² − 1)/2 with the stretch s = 1 + drawn, whatever the length."""
    s = 1 + drawn
    return 0.5 * stiffness * s * (s**2 - 1) / 2


def scene_file(text, name="sheet"):
    """A fixture: the path of a scene with this text, in the working directory of the test."""

    @pytest.fixture
    def scene(tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        path = tmp_path / f"{name}.toml"
        path.write_text(text)
        return path

    return scene
