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


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("force [N]\n1\nnan\n", "line 3, column 'force': 'nan': must be a finite number"),
        ("force [N]\n1\n\n\n", "column 'forces': is not in the file, which has force. Did you"),
        ("force [N],x [m]\n1\n", "line 2 has 1 cells: must have 2"),
        ("force [N]\n", "needs a line of names, then lines of numbers"),
        ("force [N],force [N]\n1,2\n", "must be a name of its own"),
    ],
)
def test_a_mistake_is_named_with_its_line(tmp_path, text, words):
    name = "forces" if "forces" in words else "force"
    with pytest.raises(InputError, match=words):
        read_table(write(tmp_path, text), "x").numbers(name, "N")


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match=r"no such file: must be a CSV file"):
        read_table(tmp_path / "none.csv", "x")


@pytest.mark.parametrize(
    "text",
    [
        "root:x:0:0:secret:/root:/bin/sh\nbin:x:1:1:bin:/:/bin/sh\n",
        "secret\nword\n",
        "secret,secret\nword,word\n",
        "[secret]\nkey\n",
        "machine secret login a\n12 34\n",
        "-- secret --\n1\n",
    ],
)
def test_the_text_of_a_file_that_is_no_table_is_not_told(tmp_path, text):
    with pytest.raises(InputError) as refused:
        read_table(write(tmp_path, text), "x").numbers("force", "N")
    assert "secret" not in str(refused.value)
    assert str(tmp_path / "data.csv") in str(refused.value)


def test_a_file_that_is_too_large_is_not_read(tmp_path, monkeypatch):
    monkeypatch.setattr(columns, "MOST_BYTES", 12)
    read_table(write(tmp_path, "force [N]\n1\n"), "x")
    with pytest.raises(InputError, match="has 13 bytes: must have at most 12"):
        read_table(write(tmp_path, "force [N]\n1\n\n"), "x")
