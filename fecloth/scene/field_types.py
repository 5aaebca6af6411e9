"""Types of the keys of several tables: formulas, names, files, vectors."""

from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, ValidationInfo, WithJsonSchema

from fecloth.errors import InputError
from fecloth.quantities.formula import Formula
from fecloth.quantities.units import LENGTH, is_quantity
from fecloth.validation import file_problem


def formula_text(*variables: str, condition: bool = False) -> Any:
    """Return the type of a key whose value is a formula of these variables, as text.

    With `condition` it is a condition on them, such as "X < 0.1". A plain number is allowed in
    place of a formula and becomes its text, but not in place of a condition.
    """

    def check_formula(text: str) -> str:
        """Return the text; raise `InputError` if it is no formula."""
        try:
            Formula(text, variables, condition)
        except InputError as error:
            if is_quantity(text):  # such as "5 cm", which other keys allow
                remedy = "A formula is in SI and has no units."
            else:
                remedy = error.remedy
            raise InputError(error.what, error.allowed, error.where, remedy) from None
        return text

    def write_number(value: Any) -> Any:
        """Return a number as text, and other values as they are."""
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if is_number and not condition:
            return repr(value)
        return value

    schema = WithJsonSchema({"type": "string" if condition else ["number", "string"]})
    return Annotated[str, BeforeValidator(write_number), AfterValidator(check_formula), schema]


def _check_name(name: str) -> str:
    is_allowed = all(letter.isalnum() or letter in "_- " for letter in name)
    if not name or not is_allowed:
        raise InputError("", "must consist of letters, digits, spaces, _ and -")
    return name


def resolve_path(value: str, info: ValidationInfo) -> str:
    """Return the absolute path of a file; raise `InputError` if there is no such file."""
    folder = Path((info.context or {}).get("folder", "."))
    path = folder / value
    if problem := file_problem(path):
        reason, remedy = problem
        raise InputError("", f"{path}: {reason}", remedy=remedy)
    return str(path.resolve())


Name = Annotated[str, AfterValidator(_check_name)]
File = Annotated[str, AfterValidator(resolve_path)]  # absolute, for copies of the scene
OfTime = formula_text("t")
OfTimeAndPlace = formula_text("t", "X", "Y")
OfPlace = formula_text("X", "Y")
Where = formula_text("X", "Y", condition=True)
Vector = tuple[float, float, float]
Length = Annotated[float, LENGTH]
