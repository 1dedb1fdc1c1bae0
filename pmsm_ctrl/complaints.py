"""Errors in a design file as one line: pydantic's messages with place, value and what is accepted."""

from __future__ import annotations

from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from pmsm_ctrl.errors import DesignError, nearest

__all__ = ["built", "explain"]

Model = TypeVar("Model", bound=BaseModel)


def built(model: type[Model], source: str, **fields: Any) -> Model:
    """Return a part of a design.

    Parameters
    ----------
    model : type
        Of the part.
    source : str
        What a message calls it.
    **fields
        Its values.

    Returns
    -------
    BaseModel

    Raises
    ------
    DesignError
        Naming the field, what was found and what would have been accepted.
    """
    try:
        return model(**fields)
    except ValidationError as error:
        raise DesignError(explain(error, model, source)) from None


def explain(error: ValidationError, root: type[BaseModel], source: str, data: Any = None) -> str:
    """Turn pydantic's first error into one line: place, value found, values accepted.

    Parameters
    ----------
    error : ValidationError
    root : type
        The model that was to be built.
    source : str
        File the values come from; empty when they come from none.
    data : dict, optional
        The values: effects are named by their ids.

    Returns
    -------
    str
    """
    complaints = error.errors()
    # A misspelt name comes first, because it explains a missing one.
    first = next((c for c in complaints if c["type"] == "extra_forbidden"), complaints[0])
    written = _as_written(root, first["loc"], data)
    place = ".".join(_named((*first["loc"][:-1], written[0]) if written else first["loc"], data)) or "design"
    found = first.get("input")
    where = f"{source}: {place}" if source else place
    kind = first["type"]
    if kind == "extra_forbidden":
        known = _known_fields(root, first["loc"][:-1])
        return f"{where}: unknown field{nearest(str(first['loc'][-1]), known)} (known: {', '.join(sorted(known))})"
    if kind == "missing":
        return f"{where}: missing; {_accepted(root, first['loc'])}"
    if kind == "value_error":
        told = first["msg"].removeprefix("Value error, ")
        # a complaint of the design as a whole says the place itself
        return f"{where}: {told}" if first["loc"] else f"{source}: {told}".removeprefix(": ")
    shown = repr(found) if len(repr(found)) < 60 else f"a {type(found).__name__}"
    if written:  # of a datasheet's unit, beside what it is in that of the bound
        shown = f"{written[1]!r}, which is {first['loc'][-1]} = {found:g}"
    message = first["msg"][0].lower() + first["msg"][1:]
    for bound in ("ge", "le"):  # pydantic writes 1e-15 with all its zeros
        if bound in first.get("ctx", {}):
            message = message.rpartition(" ")[0] + f" {first['ctx'][bound]:g}"
    return f"{where}: found {shown}, but {message.replace('input ', 'it ')}; {_accepted(root, first['loc'])}"


def _as_written(root: type[BaseModel], loc: tuple[int | str, ...], data: Any) -> tuple[str, Any] | None:
    """Return the datasheet name and the number from which a field was converted; None where it is written as it is."""
    if not loc:
        return None
    table = data
    for part in loc[:-1]:
        table = table.get(part) if isinstance(table, dict) else None
    if not isinstance(table, dict) or loc[-1] in table:
        return None
    sheet: Any = getattr(_walk(root, loc[:-1]), "sheet", dict)()
    fields = (loc[-1], *(("L",) if loc[-1] in ("L_d", "L_q") else ()))
    return next(((key, value) for key, value in table.items() if key in sheet and sheet[key].field in fields), None)


def _named(loc: tuple[int | str, ...], data: Any) -> list[str]:
    """Return a place with an effect's id in place of its number, and its parameters beside the id, as a file has it."""
    parts = [str(part) for part in loc if part != "parameters"]
    if len(loc) > 2 and loc[0] == "effects" and isinstance(loc[1], int) and isinstance(data, dict):
        entry = dict(enumerate(data.get("effects") or ())).get(loc[1])
        name = entry.get("id") if isinstance(entry, dict) else None
        parts[1] = name if isinstance(name, str) and name else parts[1]
    return parts


def _walk(root: type[BaseModel], loc: tuple[int | str, ...]) -> Any:
    """Follow a location through the model fields; None where it leaves them."""
    model: Any = root
    for part in loc:
        if isinstance(part, int):
            continue
        field = getattr(model, "model_fields", {}).get(part)
        if field is None:
            return None
        inner = [
            arg
            for arg in (field.annotation, *getattr(field.annotation, "__args__", ()))
            if hasattr(arg, "model_fields")
        ]
        model = inner[0] if inner else field
    return model


def _known_fields(root: type[BaseModel], loc: tuple[int | str, ...]) -> list[str]:
    model = _walk(root, loc)
    fields = [name for name in getattr(model, "model_fields", {}) if name != "source"]
    return [*fields, *getattr(model, "datasheet_names", list)()]


def _accepted(root: type[BaseModel], loc: tuple[int | str, ...]) -> str:
    field = _walk(root, loc)
    description = getattr(field, "description", None)
    if description:
        return f"accepted: {description}"
    if hasattr(field, "model_fields"):
        return f"accepted: a table with {', '.join(n for n in field.model_fields if n != 'source')}"
    if "parameters" in loc:
        return "accepted: a number in SI units"
    return "the docs' page 'A design, field by field' lists the fields"
