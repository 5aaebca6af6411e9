"""A statement of choose.py: what a cloth is, what to take for it, and the numbers that say so.

A number is (value, least, most): what a study has measured, and the range in which its statement
holds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from choose_tables import Tables

Numbers = Mapping[str, tuple[float, float, float]]
FINITE = 1e12


@dataclass(frozen=True)
class Rule:
    """A row of the table; `because` names its numbers in braces, `studies` where they stand."""

    have: str
    take: str
    because: str
    studies: str
    numbers: Callable[[Tables], Numbers]


def ruling(rules: list[Rule]) -> Callable:
    """A decorator of a rule's numbers that adds the rule to the list."""

    def rule(have: str, take: str, because: str, studies: str) -> Callable:
        return lambda numbers: rules.append(Rule(have, take, because, studies, numbers))

    return rule


def told(value: float) -> tuple[float, float, float]:
    """A number that nothing hangs on, as long as there is one."""
    return value, -FINITE, FINITE


def most(value: float, limit: float) -> tuple[float, float, float]:
    return value, -FINITE, min(limit, FINITE)


def least(value: float, limit: float) -> tuple[float, float, float]:
    return value, limit, FINITE


def never(value: float) -> tuple[float, float, float]:
    """Seconds to an error that no run comes to."""
    return value, math.inf, math.inf
