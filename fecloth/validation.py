"""Checks of arguments of public functions: numbers, lengths, functions, objects, files."""

import math
from collections.abc import Iterable, Sequence
from numbers import Integral
from pathlib import Path
from typing import Any

import numpy as np

from fecloth.errors import InputError, brief, closest, did_you_mean, is_number

FARTHEST = 1e9  # largest coordinate [m]; products of larger ones lose their meaning
MOST_TRIANGLES = 20_000_000  # for more, h is assumed to be a mistake


def number(name: str, value: object, above: float, where: str, *, infinite: bool = False) -> None:
    """Raise `InputError` for anything but a finite number > `above`, or inf if `infinite`."""
    is_infinite = isinstance(value, float) and value == math.inf
    if not ((infinite and is_infinite) or (is_number(value) and value > above)):
        allowed = f"must be a finite number > {above:g}"
        if infinite:
            allowed += ", or infinite"
        raise InputError(f"{name} = {brief(value)}", allowed, where)


def positive(name: str, value: object, unit: str, where: str, *, or_zero: bool = False) -> None:
    """Raise `InputError` for anything but a finite number > 0, or >= 0 with `or_zero`."""
    if not (is_number(value) and (value > 0 or (or_zero and value == 0))):
        allowed = "must be finite and "
        allowed += ">= 0" if or_zero else "> 0"
        if unit:
            allowed += f" [{unit}]"
        raise InputError(f"{name} = {value!r}", allowed, where)


def whole(name: str, value: Any, least: int, where: str, most: int | None = None) -> None:
    """Raise `InputError` for anything but an integer from `least`, up to `most` if given."""
    is_whole = isinstance(value, Integral) and not isinstance(value, bool)
    if not (is_whole and least <= value and (most is None or value <= most)):
        if most is None:
            allowed = f"must be an integer >= {least}"
        else:
            allowed = f"must be an integer from {least} to {most}"
        raise InputError(f"{name} = {value!r}", allowed, where)


def one_of(name: str, value: object, names: Sequence[str], where: str) -> None:
    """Raise `InputError` for a value that is none of the names."""
    if value not in names:
        *first, last = (f'"{name}"' for name in names)
        raise InputError(f"{name} = {value!r}", f"must be {', '.join(first)} or {last}", where)


def known(
    what: str, name: object, names: Iterable[str], where: str = "", always: bool = False
) -> None:
    """Raise `InputError` about `what` for a name that is none of the names.

    The message suggests the closest name if one is alike, or with `always` in any case.
    """
    if name not in (names := list(names)):
        allowed = f"must be one of {', '.join(names) or '(none)'}"
        raise InputError(what, allowed, where, did_you_mean(name, names, always))


def function(name: str, value: object, example: str, where: str) -> None:
    """Raise `InputError` for a value that cannot be called, and for a class."""
    if not callable(value) or isinstance(value, type):
        allowed = f"must be a function, as in {example}"
        raise InputError(f"{name} = {brief(value)}", allowed, where)


def instance(name: str, value: object, cls: type | tuple, example: str, where: str) -> None:
    """Raise `InputError` for a value that is not an object of the class."""
    if not isinstance(value, cls):
        raise InputError(f"{name} = {brief(value)}", f"must be such as {example}", where)


def length(name: str, value: Any, where: str) -> None:
    """Raise `InputError` for anything but a finite length > 0 and at most `FARTHEST` [m].

    A text is refused, too, even if it is a number.
    """
    try:
        is_length = not isinstance(value, (str, bytes, bool)) and 0 < float(value) < math.inf
    except (TypeError, ValueError):
        is_length = False
    if not is_length:
        raise InputError(f"{name} = {value!r}", "must be a finite length > 0, in m", where)
    if value > FARTHEST:
        raise InputError(f"{name} = {value:g} m", f"must be at most {FARTHEST:g} m", where)


def mesh_size(h: Any, extent: float, area: float, where: str) -> None:
    """Check an edge length h [m]: raise `InputError` if it does not fit the cloth to be meshed.

    `extent` [m] is the largest length of the cloth, such as the longer side of a rectangle or
    the radius of a disk, and `area` [m²] its area. h must be a length, be at most the extent,
    and give at most `MOST_TRIANGLES` triangles.
    """
    length("h", h, where)
    if h > extent:
        allowed = f"must be at most {extent:g} m"
        remedy = "Use a smaller h."
        # In mm it would be a usable h: at least two edges along the extent.
        if h / 1000 < extent / 2:
            remedy = f"Use a smaller h, or write {h / 1000:g} if you meant mm."
        raise InputError(f"h = {h:g} m", allowed, where, remedy)
    equilateral = math.sqrt(3) / 4  # area of an equilateral triangle with edges of 1 m
    count = float(area) / equilateral / h / h  # not over h², which is 0 for a tiny h
    if count > MOST_TRIANGLES:
        least = math.sqrt(area / equilateral / MOST_TRIANGLES)
        what = f"h = {h:g} m would make about {count:.1e} triangles"
        allowed = f"h must be at least {least:.2g} m"
        remedy = "A number without unit is in metres."
        raise InputError(what, allowed, where, remedy)


def point(name: str, value: object, where: str) -> np.ndarray:
    """Return three finite numbers as an array; raise `InputError` for anything else."""
    array = np.asarray(value)
    if array.shape != (3,) or array.dtype.kind not in "iuf" or not np.isfinite(array).all():
        raise InputError(f"{name} = {value!r}", "must be three finite numbers", where)
    return array.astype(float)


def direction(name: str, value: object, where: str) -> np.ndarray:
    """Return a unit vector along three numbers; raise `InputError` if they are all zero."""
    array = point(name, value, where)
    if not array.any():
        raise InputError(f"{name} = {value!r}", "must not be zero", where)
    array /= abs(array).max()  # so that no square overflows
    return array / np.linalg.norm(array)


def file_problem(path: Path) -> tuple[str, str] | None:
    """Return why a path is no regular file, and a remedy or ""; None if it is one."""
    try:
        if path.is_file():
            return None
        if path.exists():
            kind = "is a folder" if path.is_dir() else "is not a regular file"
            return kind, ""
        if not path.parent.is_dir():
            return "no such file", f"There is no folder {path.parent}."
        return "no such file", _similar(path) or f"Look into {path.parent.resolve()}."
    except OSError as error:  # a name too long, a folder without access
        return f"cannot be opened ({error.strerror})", ""


def _similar(path: Path) -> str:
    """Return a remedy with the closest name of a file of that kind in the folder, or ""."""
    files = sorted(path.parent.iterdir())
    # Files with this suffix or with the closest one; without a suffix, all files.
    suffixes = (path.suffix, closest(path.suffix, sorted({file.suffix for file in files})))
    name_of_stem = {
        file.stem: file.name for file in files if not path.suffix or file.suffix in suffixes
    }
    close = closest(path.stem, name_of_stem)
    if close:
        return f"Did you mean {name_of_stem[close]!r}?"
    return ""
