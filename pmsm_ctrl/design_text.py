"""Text of a design that was read from a file and then changed: comments, order, units and fields of the file stay."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pmsm_ctrl.errors import DesignError, NextCommand
from pmsm_ctrl.units import DATASHEET

__all__ = ["design_in_json", "edited_text", "plain", "same", "text_of_file", "with_tuples"]

MAX_FILE = 1 << 24  # bytes of a design


def design_in_json(text: str, source: str) -> dict[str, Any]:
    """Return the design that a command found, of the JSON that it wrote.

    Parameters
    ----------
    text : str
        JSON.
    source : str
        Its file, for messages.

    Raises
    ------
    DesignError
        When it is no JSON, or holds no design.
    """
    try:
        told = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise DesignError(f"{source}: not JSON ({error}); a design in TOML was expected") from None
    found = told.get("design") if isinstance(told, dict) else None
    if not isinstance(found, dict):
        raise DesignError(
            f"{source}: no design in it; a design in TOML was expected, or the --json of a command that finds one: "
            "tune, sweep, identify, diagnose, add, frf, compensate"
        )
    return found


def edited_text(text: str, before: Mapping[str, Any], after: Mapping[str, Any]) -> str | None:
    """Return the text of a design file, changed where the design was changed.

    Parameters
    ----------
    text : str
        TOML.
    before : dict
        The design in this text, as plain SI values with defaults left out.
    after : dict
        The design to be written, in the same form.

    Returns
    -------
    str or None
        None where the text cannot be edited.
    """
    try:
        import tomlkit
        from tomlkit.exceptions import TOMLKitError
    except ImportError:  # an environment older than this dependency
        return None
    try:
        document = tomlkit.parse(text)
        _edit(document, before, after)
        changed = tomlkit.dumps(document)
    except (TOMLKitError, AttributeError, KeyError, TypeError, ValueError):  # the caller writes the design anew
        return None
    return changed if "\n\n\n" in text else re.sub(r"\n{3,}", "\n\n", changed)


def plain(value: Any) -> Any:
    """Return a design as plain values without what is empty, and with lists in place of tuples.

    Parameters
    ----------
    value : object
    """
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items() if item not in ({}, ())}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value


def same(one: Any, other: Any) -> bool:
    """Return whether two designs as plain values are the same, but for the rounding of a change of unit.

    Parameters
    ----------
    one, other : object
    """
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=1e-14) or one == other
    return bool(one == other)


def with_tuples(value: Any) -> Any:
    """Return plain values with tuples in place of lists.

    Parameters
    ----------
    value : object
    """
    if isinstance(value, dict):
        return {key: with_tuples(item) for key, item in value.items()}
    if isinstance(value, list):
        return tuple(with_tuples(item) for item in value)
    return value


def _edit(table: Any, before: Mapping[str, Any], after: Mapping[str, Any]) -> None:
    """Change what differs between two versions of a table."""
    for key in before:
        if key not in after:
            for name in _names_of(table, key):
                table.remove(name)
    for key, value in after.items():
        if before.get(key) == value:
            continue
        old = before.get(key)
        if isinstance(value, Mapping) and isinstance(old, Mapping) and key in table:
            _edit(table[key], old, value)
        elif key == "effects" and isinstance(old, Sequence) and _is_array_of_tables(table.get(key)):
            _edit_effects(table, old, value)
        else:
            _set(table, key, value, after)


def _edit_effects(document: Any, before: Sequence[Mapping[str, Any]], after: Sequence[Mapping[str, Any]]) -> None:
    """Edit the effects that stay, each known by its id and its place among those of this id."""
    from tomlkit.items import AoT

    entries = document["effects"]
    known = dict(zip(_keys(before), zip(entries, before, strict=True), strict=True))
    chosen = []
    for key, effect in zip(_keys(after), after, strict=True):
        entry, old = known.get(key, (None, {}))
        if entry is None:
            entry = _table(effect)
        else:
            _edit(entry, old, effect)
        chosen.append(entry)
    if [id(one) for one in chosen[: len(entries)]] == [id(one) for one in entries]:
        for entry in chosen[len(entries) :]:
            tail = _take_tail(entries[-1].value.body)  # comments above what follows stay there
            entry.trivia.indent = "\n"
            entries.append(entry)
            entry.value.body.extend(tail)
    else:
        document["effects"] = AoT(chosen)


def _keys(effects: Sequence[Mapping[str, Any]]) -> list[tuple[str, int]]:
    ids = [str(effect["id"]) for effect in effects]
    return [(name, ids[:k].count(name)) for k, name in enumerate(ids)]


def _set(table: Any, key: str, value: Any, fields: Mapping[str, Any]) -> None:
    """Set a field under the name that it has in the table, which may be that of a datasheet value."""
    names = _names_of(table, key)
    sheet = DATASHEET.get(names[0]) if names else None
    if sheet is not None and (sheet.field == key or fields.get("L_d") == fields.get("L_q")):
        table[names[0]] = _in_unit(float(value), sheet.to_si(1.0, float(fields.get("p", 1))))
        return
    if sheet is not None:  # one inductance for both axes, which now differ
        table.remove(names[0])
        for name in ("L_d", "L_q"):
            _add(table, name, fields[name])
        return
    if isinstance(value, Sequence) and value and isinstance(value[0], Mapping):
        import tomlkit

        array = tomlkit.aot()
        for one in value:
            array.append(_table(one))
        if key in table:
            table.remove(key)
        table.append(key, array)
    else:
        item = value if not isinstance(value, Mapping) else _inline(value) if key == "stderr" else _table(value)
        if names:
            table[key] = item
        else:
            _add(table, key, item)


def _add(table: Any, key: str, item: Any) -> None:
    """Add a field behind the last one, before the comments that stand above the next table."""
    body = [] if hasattr(table, "body") else table.value.body  # a document keeps its tables apart itself
    tail = _take_tail(body)
    table.append(key, item)
    body.extend(tail)


def _take_tail(body: list[Any]) -> list[Any]:
    """Take the blank lines and comments behind the last field out of a table."""
    tail = []
    while body and body[-1][0] is None:
        tail.append(body.pop())
    return tail[::-1]


def _names_of(table: Any, key: str) -> list[str]:
    """Names under which a table holds a field."""
    fields = {key, "L"} if key in ("L_d", "L_q") else {key}
    return [name for name in table if name == key or (name in DATASHEET and DATASHEET[name].field in fields)]


def _in_unit(value: float, factor: float) -> float:
    """Return a value in the unit of its field, with no more digits than it takes to give the same SI value back."""
    for digits in range(1, 18):
        found = float(f"{value / factor:.{digits}g}")
        if math.isclose(found * factor, value, rel_tol=1e-14):
            return found
    return value / factor


def _is_array_of_tables(item: Any) -> bool:
    return type(item).__name__ == "AoT"


def _table(values: Mapping[str, Any]) -> Any:
    import tomlkit

    table = tomlkit.table()
    for key, value in values.items():
        if isinstance(value, Mapping):
            table.append(key, _inline(value) if key == "stderr" else _table(value))
        else:
            table.append(key, value)
    return table


def _inline(values: Mapping[str, Any]) -> Any:
    import tomlkit

    table = tomlkit.inline_table()
    table.update(values)
    return table


def text_of_file(path: str | os.PathLike[str]) -> str:
    """Return the text of a design's file.

    Parameters
    ----------
    path : path

    Raises
    ------
    DesignError
        When `path` is none, or the file is missing, too large, or no text.
    """
    if not isinstance(path, str | os.PathLike):
        hint = "; Design.from_dict takes a dict" if isinstance(path, dict) else ""
        raise DesignError(f"a {type(path).__name__} found; the path of a design in TOML was expected{hint}")
    try:
        if Path(path).exists() and not (Path(path).is_file() or Path(path).is_dir()):
            raise DesignError(f"{path}: not a file; a design in TOML was expected")
        if Path(path).stat().st_size > MAX_FILE:
            raise DesignError(f"{path}: larger than {MAX_FILE >> 20} MB; a design in TOML was expected")
        return Path(path).read_bytes().decode("utf-8")
    except FileNotFoundError:
        message = f"{path}: no such file; a design in TOML was expected"
        raise DesignError(message, next_command=NextCommand.INIT) from None
    except OSError as error:
        raise DesignError(f"{path}: cannot be read ({error.strerror})") from None
    except UnicodeDecodeError as error:
        raise DesignError(f"{path}: not UTF-8 text at byte {error.start}; a design in TOML was expected") from None
    except ValueError as error:  # a name with a zero byte
        raise DesignError(f"{os.fspath(path)!r}: cannot be read ({error})") from None
