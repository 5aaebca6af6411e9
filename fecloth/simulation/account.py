"""What a run accounts for, beside its motion: a list of figures that follow its steps."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Self, TypeVar, cast

import numpy as np

from fecloth.mesh.surface import Surface
from fecloth.simulation.doubts.doubt import Doubt, DoubtKind
from fecloth.simulation.doubts.jumps import find_load_jumps
from fecloth.simulation.doubts.signals import find_signals
from fecloth.simulation.steps import StepInfo
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.records import remembered

NEVER = 2**62  # the number of no step


@dataclass(frozen=True, eq=False)
class Run:
    """What the accounts know of their run.

    Attributes
    ----------
    system
        What moves.
    method
        The method as reports name it; see `method_to_report`.
    start
        The state before the first step.
    step
        Number of the last step before the start.
    most_growth
        As for `run`.
    t_end
        The end of the run [s].
    error_in_time
        As `time_error` of `run`.
    """

    system: System
    method: Any
    start: State
    step: int
    most_growth: float
    t_end: float
    error_in_time: str = "sampled"

    def at(self, t: float) -> "Run":
        """The run with the pins that hold from the time t [s] on."""
        system = self.system.after(t)
        if system is self.system:
            return self
        return replace(self, system=system)

    @cached_property
    def surface(self) -> Surface:
        """The triangles of the cloth, whose intersections are counted."""
        return Surface.from_cloth(self.system.cloth)

    @cached_property
    def load_jumps(self) -> np.ndarray:
        """When loads and the points of tethers jump (k,) [s], in their order."""
        signals = find_signals(self.system, self.start, self.t_end, True)
        return find_load_jumps(signal for signal in signals if signal.kind in ("load", "tether"))


@dataclass(frozen=True, eq=False)
class End:
    """Where a run has ended.

    Attributes
    ----------
    state
        The last state.
    step
        Number of the last step.
    is_whole
        Whether the run has reached its `t_end`.
    """

    state: State
    step: int
    is_whole: bool = True


class Account:
    """A figure of a run: a frozen record of the steps so far, marked with `remembered`.

    Each step replaces it. The map of fecloth (fecloth/README.md) says how to add one.

    Attributes
    ----------
    name
        Its name in restart files and in `Accounts.records`.
    table
        The table that has its `row`: "energies", "observed" or "steps".
    due
        Number of the step that must have a row for it.
    sentence
        A line for the log at the end, with -v also for the terminal; or "".
    """

    name: ClassVar[str]
    table: ClassVar[str] = "observed"
    due: int = NEVER
    sentence: str = ""

    @classmethod
    def begin(cls, run: Run, others: "Accounts") -> Self:
        """Return the record before the first step; `others` are those before it in the list."""
        return cls()

    def follow(self, run: Run, info: StepInfo, others: "Accounts") -> Self:
        """Return the record after a step that has a row.

        `others` are the accounts before it in the list, after this step.
        """
        return self

    def release(self, run: Run, info: StepInfo, others: "Accounts") -> Self:
        """Return the record where pins let go at the end of a step, after `follow`.

        `run` has the pins that are left, and `others` are those before it in the list.
        """
        return self

    def finish(self, run: Run, end: End, others: "Accounts") -> Self:
        """Return the record with what only the end of the run tells."""
        return self

    def changed(self, **values: Any) -> Self:
        """Return a copy with other values."""
        return replace(cast(Any, self), **values)

    def row(self) -> Mapping[str, float]:
        """Return columns of the row of the last step, at the start too."""
        return {}

    def doubts(self) -> Iterable[Doubt]:
        """Return reasons to doubt the run so far; a run reports each kind of them once."""
        return ()

    def words(self) -> str:
        """Return a line for the log at the end, with -v also for the terminal; or ""."""
        return self.sentence

    def summary(self) -> Mapping[str, object]:
        """Return entries of summary.json."""
        return {}


A = TypeVar("A", bound=Account)


@remembered
@dataclass(frozen=True, eq=False)
class Accounts:
    """The accounts of a run by their names, in the order of their list."""

    records: Mapping[str, Account]

    @classmethod
    def begin(cls, kinds: Sequence[type[Account]], run: Run, first: Account) -> "Accounts":
        """Return the accounts before the first step; `first` has begun already."""
        accounts = cls({first.name: first})
        for kind in kinds:
            accounts = accounts.with_record(kind.begin(run, accounts))
        return accounts

    def follow(self, run: Run, info: StepInfo) -> "Accounts":
        """Return the accounts after a step that has a row."""
        return self._replace_each(lambda record, others: record.follow(run, info, others))

    def release(self, run: Run, info: StepInfo) -> "Accounts":
        """Return the accounts where pins let go at the end of a step."""
        return self._replace_each(lambda record, others: record.release(run, info, others))

    def finish(self, run: Run, end: End) -> "Accounts":
        """Return the accounts at the end of the run."""
        return self._replace_each(lambda record, others: record.finish(run, end, others))

    def _replace_each(self, new: "Callable[[Account, Accounts], Account]") -> "Accounts":
        """Return new records, each made from the old one and the new ones before it."""
        records: dict[str, Account] = {}
        after = Accounts(records)
        for name, record in self.records.items():
            records[name] = new(record, after)
        return after

    def with_record(self, record: Account) -> "Accounts":
        """Return the accounts with a record in the place of the old one of its name."""
        return Accounts({**self.records, record.name: record})

    def __getitem__(self, kind: type[A]) -> A:
        record = self.records[kind.name]
        assert isinstance(record, kind)
        return record

    def get(self, kind: type[A]) -> A | None:
        """Return the record of a kind, None where the run has none."""
        if kind.name in self.records:
            return self[kind]
        return None

    @property
    def due(self) -> int:
        """Number of the step that must have the next row."""
        return min(record.due for record in self.records.values())

    def rows(self, observed: Mapping[str, float]) -> dict[str, dict[str, float]]:
        """Return the rows of the tables; `observed` are the first columns of "observed"."""
        rows: dict[str, dict[str, float]] = {
            "energies": {},
            "observed": dict(observed),
            "steps": {},
        }
        for record in self.records.values():
            rows[record.table].update(record.row())
        return rows

    def new_doubts(self, raised: Sequence[Doubt]) -> list[Doubt]:
        """Return the doubts of kinds that have not been raised yet."""
        new: dict[DoubtKind, Doubt] = {}
        known = {doubt.kind for doubt in raised}
        for record in self.records.values():
            for doubt in record.doubts():
                if doubt.kind not in known:
                    new.setdefault(doubt.kind, doubt)
        return list(new.values())

    def words(self) -> list[str]:
        """Return the lines of all accounts for the end of the log."""
        return [words for record in self.records.values() if (words := record.words())]

    def summary(self) -> dict[str, object]:
        """Return the entries of all accounts in summary.json."""
        entries = [record.summary() for record in self.records.values()]
        return {key: value for entry in entries for key, value in entry.items()}
