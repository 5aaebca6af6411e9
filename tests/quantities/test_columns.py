"""Columns of a measurement: units, comments, and a line for each mistake."""

import pytest

from fecloth.errors import InputError
from fecloth.quantities import columns
from fecloth.quantities.columns import factor_to_si, read_table


def write(tmp_path, text):
    path = tmp_path / "data.csv"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("unit", "si", "factor"),
    [
        ("mm", "m", 1e-3),
        ("N", "N", 1.0),
        ("gf", "N", 9.80665e-3),
        ("N/cm", "N/m", 100.0),
        ("ms", "s", 1e-3),
        ("cm^2", "m²", 1e-4),
        ("mJ", "J", 1e-3),
        ("%", "", 0.01),
        ("-", "", 1.0),
        (None, "", 1.0),
    ],
)
def test_units_of_headers(unit, si, factor):
    assert factor_to_si("x", unit, si) == pytest.approx(factor, rel=1e-12)


def test_columns_are_in_si_and_comments_are_left_out(tmp_path):
    table = read_table(write(tmp_path, "# a strip\nextension [mm], force [N]\n\n1,2\n3,4\n"), "x")
    assert table.numbers("extension", "m").tolist() == [1e-3, 3e-3]
    assert table.numbers("force", "N").tolist() == [2.0, 4.0]
    assert list(table.lines) == [4, 5]


def test_a_mapping_serves_as_a_file():
    table = read_table({"force [mN]": [1.0, 2.0]}, "x")
    assert table.numbers("force", "N").tolist() == [1e-3, 2e-3]


def test_a_file_that_is_too_large_is_not_read(tmp_path, monkeypatch):
    monkeypatch.setattr(columns, "MOST_BYTES", 12)
    read_table(write(tmp_path, "force [N]\n1\n"), "x")
    with pytest.raises(InputError, match="has 13 bytes: must have at most 12"):
        read_table(write(tmp_path, "force [N]\n1\n\n"), "x")
