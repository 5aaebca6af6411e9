"""Types of the keys of several tables: formulas, names, files, vectors."""

from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, ValidationInfo, WithJsonSchema

from fecloth.errors import InputError
from fecloth.quantities.formula import Formula
from fecloth.quantities.units import LENGTH, is_quantity
from fecloth.validation import file_problem


def formula_text(*variables: str, condition: bool = False) -> Any:
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
    if not name or not all(c.isalnum() or c in "_- " for c in name):
        raise InputError("", "must consist of letters, digits, spaces, _ and -")
    return name


def resolve_path(value: str, info: ValidationInfo) -> str:
    path = Path((info.context or {}).get("folder", ".")) / value
    if problem := file_problem(path):
        raise InputError("", f"{path}: {problem[0]}", "", problem[1])
    return str(path.resolve())


Name = Annotated[str, AfterValidator(_check_name)]
File = Annotated[str, AfterValidator(resolve_path)]  # absolute, for copies of the scene
OfTime = formula_text("t")
OfTimeAndPlace = formula_text("t", "X", "Y")
OfPlace = formula_text("X", "Y")
Where = formula_text("X", "Y", condition=True)
Vector = tuple[float, float, float]
Length = Annotated[float, LENGTH]
