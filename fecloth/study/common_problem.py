"""What a scene and a user's function have in common as problems of a study."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from fecloth.errors import InputError
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.probes import Observer
from fecloth.simulation.quantity import Quantity, parse_quantity
from fecloth.study.orders import space_order
from fecloth.study.setups import Setup

Asked = str | Callable[..., float] | Quantity


class CommonProblem:
    """What both kinds of problems derive from their name, first level and quantities.

    `quantities` are those that count unless a study is asked for others.
    """

    name: str
    first: Setup
    quantities: tuple[Quantity, ...]

    @property
    def is_static(self) -> bool:
        return self.first.is_static

    @property
    def is_explicit(self) -> bool:
        return self.first.is_explicit

    def orders(self, quantity: Quantity) -> tuple[float, float]:
        """Return the theoretical orders in h and in dt."""
        time = 1.0 if self.is_static else float(self.first.steps.traits.order or 1)
        return space_order(quantity, self.first), time

    def choose_quantities(self, asked: Asked | Sequence[Asked] | None) -> tuple[Quantity, ...]:
        """Return the quantities that are asked for, or the problem's own."""
        several = isinstance(asked, Sequence) and not isinstance(asked, str)
        listed: Any = self.quantities if asked is None else asked if several else (asked,)
        found = tuple(parse_quantity(one) for one in listed)
        for one in found:
            self.check_quantity(one)
        if len({one.how == "mode" for one in found}) > 1 and not self.is_static:
            allowed = "needs a study of its own: a scene in time is not run for its modes"
            raise InputError("frequency(k) beside other quantities", allowed, self.name)
        return found

    def choose_quantity(self, asked: Asked | None) -> Quantity:
        """Return the quantity that is asked for, or the first of the problem's own."""
        return self.choose_quantities(self.quantities[:1] if asked is None else asked)[0]

    def check_quantity(self, quantity: Quantity) -> None:
        """Raise `InputError` for a quantity that the run does not have."""
        setup = self.first
        observer = Observer.bind(setup.system, setup.start, setup.probes, shape=True)
        names = {*observer.row(None, None), *Ledger.open(setup.system, setup.start).row()}
        quantity.require_known(sorted(names - {"t"}))


def quantities_of(probes: Sequence[str], static: bool) -> tuple[Quantity, ...]:
    """Return the usual quantities of a run with these probes."""
    names = [name if static else f"path of {name}" for name in probes]
    return tuple(parse_quantity(name) for name in names or ["displacement"])
