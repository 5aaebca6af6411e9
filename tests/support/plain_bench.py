"""A bench of fronts whose rows are plain numbers, and a limit that knows its distances."""

import math
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np


@dataclass(eq=False)
class PlainBench:
    """The value of a setting is 1 + a h² + b dt², and its seconds are `speed` h⁻² dt⁻¹."""

    a: float = 1.0
    b: float = 1.0
    speed: dict = field(default_factory=dict)
    seconds: float = 1e9
    spent: float = 0.0
    left: float = 1e9
    worth: object = None
    quantities: tuple = ("x",)
    rows: dict = field(default_factory=dict)
    asked: list = field(default_factory=list)
    orders: tuple = (2.0, 2.0)
    has_h: bool = True
    has_dt: bool = True

    def with_sharper_solver(self):
        return self

    @property
    def settings(self):
        where = SimpleNamespace(where="plain")
        return SimpleNamespace(
            varies=lambda line: (self.has_h, self.has_dt),
            can_be_finer=lambda setting: (self.has_h, self.has_dt),
            problem=where,
        )

    def run(self, setting, most=math.inf):
        self.asked.append((setting, most))
        took = self.took(setting)
        if took > most:
            return {"status": "time limit", "cause": "late"}
        problem = SimpleNamespace(orders=lambda quantity: self.orders, dt=0.1)
        value = self.value(setting)
        row = {"status": "ok", "value": value, "errors": [value - 1.0], "problem": problem}
        self.rows[setting] = row
        self.spent += took
        self.left -= took
        return row

    def value(self, setting):
        if self.worth is not None:
            return self.worth(setting)
        return 1.0 + self.a * 2.0**-setting.i + self.b * 4.0**-setting.j

    def took(self, setting):
        return self.speed.get(setting.line, 1.0) * 2.0**setting.i * 2.0**setting.j

    def is_ok(self, setting):
        return self.rows.get(setting, {}).get("status") == "ok"

    def allows(self, seconds):
        return seconds <= self.left / 3


class PlainLimit:
    """A limit to which each row knows its distances."""

    def __init__(self, *uncertainty):
        self.uncertainty = np.array(uncertainty)

    def error(self, row):
        return np.array(row["errors"])
