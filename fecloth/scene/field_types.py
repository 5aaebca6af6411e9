"""Types of the keys of several tables: formulas, names, files, vectors."""

from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, ValidationInfo, WithJsonSchema

from fecloth.errors import InputError
from fecloth.quantities.formula import Formula
from fecloth.quantities.units import LENGTH, is_quantity
from fecloth.validation import file_problem


def formula_text(*variables: str, condition: bool = False) -> Any:
    """Return the type of a key with a formula of these variables, or a condition on them.

    A plain number is allowed in place of a formula, but not in place of a condition.
    """

    def check(text: str) -> str:
        try:
            Formula(text, variables, condition)
        except InputError as error:
            if is_quantity(text):
                remedy = "A formula is in SI and has no units."
            else:
                remedy = error.remedy
            raise InputError(error.what, error.allowed, error.where, remedy) from None
        return text

    def text(value: Any) -> Any:
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if number and not condition:
            return repr(value)
        return value

    schema = WithJsonSchema({"type": "string" if condition else ["number", "string"]})
    return Annotated[str, BeforeValidator(text), AfterValidator(check), schema]


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
        raise InputError("", f"{path}: {reason}", "", remedy)
    return str(path.resolve())


Name = Annotated[str, AfterValidator(_check_name)]
File = Annotated[str, AfterValidator(resolve_path)]  # absolute, for copies of the scene
OfTime = formula_text("t")
OfTimeAndPlace = formula_text("t", "X", "Y")
OfPlace = formula_text("X", "Y")
Where = formula_text("X", "Y", condition=True)
Vector = tuple[float, float, float]
Length = Annotated[float, LENGTH]
