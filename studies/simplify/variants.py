"""The simpler scenes that needs.py tries: each a change of the tables of a scene."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from fecloth.integrators import EXPLICIT
from fecloth.scene.tables import Interest
from fecloth.simulation.error_control import Adaptive

Data = dict
MEMBRANES = ("StVK", "TensorCondition", "BaraffWitkin", "NeoHookean", "TensionField")
LONG = 1e5  # s, a step of backward Euler that leaves no inertia
LARGER = (2, 4)  # times dt, rtol
COARSER = (1.5, 2.0)  # times h


@dataclass(frozen=True)
class Variant:
    """A change of a scene.

    Attributes
    ----------
    name
        For tables.
    kind, by
        What the prediction goes by: the kind of change, and its term's type or its factor.
    slot
        What of the scene it changes: of two with one slot the reduced scene takes one.
    apply
        From the tables of a scene to those of the simpler one.
    static
        Whether the state at the end is sought by `equilibrium`.
    """

    name: str
    kind: str
    by: object
    slot: str
    apply: Callable[[Data], Data]
    static: bool = False


def variants(data: Data, interest: Interest) -> list[Variant]:
    """All that a scene allows, terms first."""
    found = [one for term in data.get("terms", []) for one in of_term(term)]
    found += [*of_mesh(data), *of_time(data)]
    if not (interest.path or interest.period):
        found.append(Variant("equilibrium", "static", None, "time", lambda data: data, True))
        found.append(Variant("one long step", "static", None, "time", one_step))
    return found


def of_term(term: Data) -> Iterator[Variant]:
    """Without it, and with its cheaper sibling."""
    name, slot = term["type"], f"term {term}"
    yield Variant(f"without {name}", "without", name, slot, swap(term, None))
    if name in MEMBRANES:
        springs = swap(term, {"type": "Springs"})
        yield Variant(f"Springs for {name}", "springs", name, slot, springs)
    if name == "HingeBending":
        quadratic = swap(term, {"type": "QuadraticBending"})
        yield Variant("QuadraticBending for hinges", "quadratic", name, slot, quadratic)


def swap(term: Data, other: Data | None) -> Callable[[Data], Data]:
    """The change that puts `other` in the place of a term, or nothing.

    What [expect] says of the term's own columns goes with it.
    """

    def apply(data: Data) -> Data:
        terms = [other if one == term else one for one in data["terms"]]
        gone = {head + term["type"] for head in ("", "dissipated:", "work:")}
        expect = {key: value for key, value in data.get("expect", {}).items() if key not in gone}
        return data | {"terms": [one for one in terms if one], "expect": expect}

    return apply


def of_mesh(data: Data) -> Iterator[Variant]:
    """Larger triangles, P1 in place of P2."""
    if "h" in data["cloth"]:
        for factor in COARSER:
            change = within("cloth", h=lambda h, factor=factor: h * factor)
            yield Variant(f"h × {factor:g}", "mesh", factor, "mesh", change)
    if data["cloth"].get("element") == "P2":

        def linear(data: Data) -> Data:
            return within("cloth", element=lambda _: "P1")(data) | {"mass": "lumped"}

        yield Variant("P1 for P2", "P1", None, "element", linear)


def of_time(data: Data) -> Iterator[Variant]:
    """Longer steps, a looser tolerance; explicit steps near their limit."""
    time, key = data["time"], "rtol" if data["time"]["dt"] == "auto" else "dt"
    at_limit = key == "rtol" and method_of(data) in EXPLICIT and not {"rtol", "atol"} & set(time)
    for factor in () if at_limit else LARGER:
        if key == "dt" and steps(time, factor) == steps(time, 1):
            continue
        yield Variant(f"{key} × {factor}", key, factor, "time", longer(key, factor))
    if method_of(data) not in (*EXPLICIT, "auto") and data["cloth"].get("element") != "P2":
        yield Variant("explicit", "explicit", None, "time", explicit)


def steps(time: Data, factor: float) -> int:
    """How many steps there are with dt times a factor."""
    return math.ceil((time["t_end"] - time.get("t_start", 0.0)) / (factor * time["dt"]) - 1e-9)


def longer(key: str, factor: float) -> Callable[[Data], Data]:
    """dt or rtol times a factor; frames no closer than the steps."""

    def apply(data: Data) -> Data:
        value = data["time"].get(key, Adaptive.rtol)
        new = data | {"time": data["time"] | {key: value * factor}}
        every = new["output"].get("every")
        if key == "dt" and every and every < new["time"]["dt"]:
            new["output"] = {"every": new["time"]["dt"]}
        return new

    return apply


def explicit(data: Data) -> Data:
    """Central differences at 0.9 of their stability limit."""
    span = {key: data["time"][key] for key in ("t_start", "t_end") if key in data["time"]}
    time = {"method": "central_difference", "dt": "auto", **span}
    return data | {"time": time, "mass": "lumped"}


def one_step(data: Data) -> Data:
    """One step of backward Euler to the same end: ρ Δx/dt² is nothing beside the forces.

    Far from the end the exact tangent leads nowhere: it is clamped. What [expect] says of times
    before the end has no meaning any more.
    """
    end = data["time"]["t_end"]
    time = {"method": "backward_euler", "dt": LONG, "t_start": end - LONG, "t_end": end}
    solver = {**data.get("solver", {}), "tolerance": 1e-9, "definiteness": "clamp"}
    return data | {"time": time, "solver": solver, "output": {"every_steps": 1}, "expect": {}}


def within(table: str, **changes: Callable) -> Callable[[Data], Data]:
    """The change of values of one table."""

    def apply(data: Data) -> Data:
        new = {key: change(data[table][key]) for key, change in changes.items()}
        return data | {table: data[table] | new}

    return apply


def method_of(data: Data) -> str:
    """The method's name in [time]."""
    method = data["time"]["method"]
    return method if isinstance(method, str) else method["type"]
