"""The uncertainties of a fabric of which some constants are replaced."""

from collections.abc import Iterable, Mapping
from typing import Any

from fecloth.fabric.uncertainty import CONSTANTS, constant_of, flat


def merged(own: Mapping[str, Any], replaced: Iterable[str], new: Any) -> Any:
    """Return the table of uncertainties `own`, changed by the keys of the table `new`.

    The uncertainties of the constants `replaced` (names) are left out, because they belong to
    other numbers. So are correlations with constants that have no uncertainty any more.
    """
    if not isinstance(new, Mapping):
        return new  # `Uncertainty.read` refuses it
    new = dict(flat(new))
    gone = {*new, *(CONSTANTS.keys() & set(replaced))}
    # A key goes if it, or the constant that it is a number of, is gone.
    kept = {key: value for key, value in flat(own) if not {key, constant_of(key)} & gone}
    rows = kept.pop("correlation", ())
    rows = [row for row in rows if all({key, constant_of(key)} & kept.keys() for key in row[:2])]
    if rows:
        kept["correlation"] = rows
    return kept | new
