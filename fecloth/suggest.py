"""The one "Did you mean ...?" of all error messages."""

import difflib
from collections.abc import Iterable

CUTOFF = 0.6  # least likeness of a name that is suggested; 0: one name is always suggested


def closest(name: object, names: Iterable[str], cutoff: float = CUTOFF) -> str:
    """The name that is most like `name`; empty if none is alike.

    Capitals and underscores do not count: ``CentralDifference`` is ``central_difference``.
    """
    plain = {_plain(each): each for each in names}
    word = _plain(name)
    begins = sorted((key for key in plain if len(key) > 2 and word.startswith(key)), key=len)
    close = difflib.get_close_matches(word, list(plain), n=1, cutoff=cutoff)
    both = [*begins[-1:], *close]  # as "cosine" with "cos", but "tipp.z" with "tip.z"
    likeness = [difflib.SequenceMatcher(None, each, word).ratio() for each in both]
    return plain[both[likeness.index(max(likeness))]] if both else ""


def did_you_mean(name: object, names: Iterable[str], cutoff: float = CUTOFF) -> str:
    """The remedy "Did you mean ...?" with the closest of the names; empty if none is alike."""
    close = closest(name, names, cutoff)
    return f"Did you mean {close!r}?" if close else ""


def _plain(name: object) -> str:
    """The name without capitals and underscores."""
    return str(name).lower().replace("_", "")
