"""The runner of tables of (input, message)."""

import re

import pytest

import fecloth as fc


def message_test(rows, refuse=lambda call: call()):
    """Return a test of the rows (input, regular expression); `refuse(input)` must raise.

    Beside its own words every message says what is wrong, the place of it, and what is allowed or
    how to mend it.
    """

    @pytest.mark.parametrize(("wrong", "message"), rows, ids=[message for _, message in rows])
    @pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of the wrong values themselves
    def test(wrong, message):
        with pytest.raises(fc.InputError) as caught:
            refuse(wrong)
        text = str(caught.value)
        assert re.search(message, text), text
        for error in (caught.value, *caught.value.also):
            assert error.what, text
            assert error.where, text
            assert error.allowed or error.remedy, text

    return test
