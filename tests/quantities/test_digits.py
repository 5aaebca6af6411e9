"""Numbers with as many digits as their uncertainty allows."""

from fecloth.quantities.digits import with_uncertainty


def test_an_uncertainty_of_the_size_of_round_off_adds_no_digits():
    assert with_uncertainty(-1.226249999999999e-02, 2e-16, "m") == "-0.0122625 ± 2e-16 m"


def test_a_small_uncertainty_above_round_off_decides_the_digits():
    assert with_uncertainty(1.23456789012, 2e-10) == "1.23456789012e+00 ± 2.0e-10"


def test_decimals_end_at_the_second_digit_of_the_uncertainty():
    assert with_uncertainty(1.2345, 0.1234, "m") == "1.23 ± 0.12 m"
    assert with_uncertainty(1234.5, 567.8) == "1234 ± 568"
