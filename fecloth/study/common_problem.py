"""What a scene and a user's function have in common as problems of a study."""

from __future__ import annotations

from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.probes import Observer
from fecloth.simulation.quantity import Quantity
from fecloth.study.orders import space_order
from fecloth.study.setups import Setup


class CommonProblem:
    """What both kinds of problems derive from their first level."""

    first: Setup

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

    def check_quantity(self, quantity: Quantity) -> None:
        """Raise `InputError` for a quantity that the run does not have."""
        setup = self.first
        observer = Observer.bind(setup.system, setup.start, setup.probes, shape=True)
        names = {*observer.row(None, None), *Ledger.open(setup.system, setup.start).row()}
        quantity.require_known(sorted(names - {"t"}))
