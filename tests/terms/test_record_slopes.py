"""Slopes of records: differences of numbers, and a record moved by its slopes."""

from dataclasses import dataclass

import numpy as np
import pytest

from fecloth.terms.records import shift, slope


@dataclass(frozen=True, eq=False)
class Inner:
    force: np.ndarray
    touches: bool


@dataclass(frozen=True, eq=False)
class Record:
    dt: float
    count: int
    parts: tuple
    by_name: dict


def record(p: float) -> Record:
    inner = Inner(np.array([p**2, 1.0]), touches=True)
    return Record(0.5 * p, 3, (inner, None, "text"), {"a": 2.0 * p, "n": np.array([1, 2])})


def test_slopes_are_central_differences_of_all_real_numbers():
    slopes = slope(record(1.1), record(0.9), 0.2)
    assert slopes["dt"] == pytest.approx(0.5)
    assert slopes["count"] is None
    assert slopes["parts"][0]["force"] == pytest.approx([2.0, 0.0])
    assert slopes["parts"][0]["touches"] is None
    assert slopes["parts"][1:] == (None, None)
    assert slopes["by_name"]["a"] == pytest.approx(2.0)
    assert slopes["by_name"]["n"] is None


def test_a_record_moves_by_its_slopes():
    moved = shift(record(1.0), slope(record(1.1), record(0.9), 0.2), 0.01)
    assert moved.parts[0].force == pytest.approx([1.02, 1.0])
    assert (moved.dt, moved.count) == (pytest.approx(0.505), 3)
    assert moved.by_name["a"] == pytest.approx(2.02)
    assert shift(None, None, 0.1) is None


@pytest.mark.parametrize(
    ("plus", "minus"),
    [
        (np.zeros(3), np.zeros(4)),
        ((1.0, 2.0), (1.0,)),
        ({"a": 1.0}, {"b": 1.0}),
        (record(1.0), None),
    ],
)
def test_records_of_other_forms_have_no_slope(plus, minus):
    with pytest.raises(ValueError, match=r"shapes|different|zip"):
        slope(plus, minus, 1.0)
