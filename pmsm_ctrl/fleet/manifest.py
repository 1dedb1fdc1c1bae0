"""Which logs a fleet has, and of each its axis, type, time and design."""

from __future__ import annotations

import csv
import os
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path, PurePath
from typing import Any

from pmsm_ctrl.design import DEEP, DEEPEST
from pmsm_ctrl.errors import LogError, RequestError, nearest
from pmsm_ctrl.files import read_text
from pmsm_ctrl.fleet.paths import Place, compiled, guessed
from pmsm_ctrl.fleet.remote import changed, is_file, is_remote, listed, plain
from pmsm_ctrl.importers import log_files
from pmsm_ctrl.importers.folders import SUFFIXES

__all__ = ["Item", "Manifest", "NoLogError", "Settings", "items_of", "manifest_of", "read_manifest"]


class NoLogError(RequestError):
    """A manifest that matches no file, yet."""


@dataclass(frozen=True)
class Settings:
    """What of a run changes its numbers; part of the key of every result.

    Attributes
    ----------
    joint : bool
        Whether the records of an axis are evaluated together; else every log by itself.
    compare, diagnose : bool
        Whether these are run beside `identify`.
    mapping : dict of str to str
        Channel to column, as for `read_log`, for every log.
    """

    joint: bool = False
    compare: bool = True
    diagnose: bool = True
    mapping: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Manifest:
    """A fleet: where its logs are, and how they are evaluated.

    Attributes
    ----------
    logs : tuple of str
        Files, folders (with what is below them) and patterns; also with a protocol of fsspec, such as ``s3://``.
    design : str
        The design of every axis that has none of its own; empty where each has one.
    designs : dict of str to str
        Design by axis or by type.
    results : str
        Folder of the results, likewise.
    path : str
        Pattern of the end of a path, such as ``{type}/{axis}/{time:%Y-%m-%d}.csv``; guessed where empty.
    time : {"path", "modified", "column"}
        Where the time of a log comes from: the pattern, the file's time stamp, or the first date in its time column.
    table : str
        A CSV file with the columns ``file`` and ``axis``, and optionally ``type``, ``time`` and ``design``: in place of
        `logs` and `path`.
    limits : dict of str to float
        Highest allowed value of a parameter, SI units, by symbol; the report says when a trend reaches it.
    settings : Settings
    effects : str
        Python file with own effects of every design; it is run. A manifest's file cannot name one.
    """

    logs: tuple[str, ...] = ()
    design: str = ""
    designs: Mapping[str, str] = field(default_factory=dict)
    results: str = "results"
    path: str = ""
    time: str = "path"
    table: str = ""
    limits: Mapping[str, float] = field(default_factory=dict)
    settings: Settings = field(default_factory=Settings)
    effects: str = ""


@dataclass(frozen=True)
class Item:
    """What is evaluated at once: a log, or the records of an axis together.

    Attributes
    ----------
    files : tuple of str
    axis, type : str
    time : datetime
        UTC; of the last record.
    design : str
        Path of its design.
    problem : str
        Why it cannot be evaluated, where its path says so already.
    """

    files: tuple[str, ...]
    axis: str
    type: str
    time: datetime
    design: str
    problem: str = ""

    @property
    def name(self) -> str:
        """The file, or what stands for several."""
        return self.files[0] if len(self.files) == 1 else f"{self.files[0]} and {len(self.files) - 1} more"


UNKNOWN = "(unknown)"  # axis of a file whose path does not match the pattern
_TIMES = ("path", "modified", "column")
_LISTS, _TABLES, _FLAGS = ("logs",), ("designs", "limits", "map"), ("joint", "compare", "diagnose")
_TEXTS = ("design", "results", "path", "time", "table")


def read_manifest(path: str | os.PathLike[str]) -> Manifest:
    """Return the manifest in a TOML file; its paths are relative to that file.

    Parameters
    ----------
    path : path

    Returns
    -------
    Manifest

    Raises
    ------
    RequestError
        When the file cannot be read, or holds an unknown key or a value of the wrong type.
    """
    try:
        text = read_text(path)
        if DEEP.search(text):  # tomllib takes memory with the square of the depth
            raise ValueError(f"a key of more than {DEEPEST} parts")
        content = tomllib.loads(text)
    except (OSError, ValueError, RecursionError) as error:
        raise RequestError(
            f"{path}: cannot be read as a manifest ({getattr(error, 'strerror', None) or error})"
        ) from None
    _check(str(path), content)
    folder = Path(path).parent

    def below(name: str) -> str:
        return name if is_remote(name) else os.path.normpath(folder / plain(name))

    logs = content.get("logs", ())
    manifest = Manifest(
        logs=tuple(below(one) for one in ([logs] if isinstance(logs, str) else logs)),
        design=below(content["design"]) if content.get("design") else "",
        designs={str(name): below(one) for name, one in content.get("designs", {}).items()},
        results=below(content.get("results", "results")),
        path=content.get("path", ""),
        time=content.get("time", "path"),
        table=below(content["table"]) if content.get("table") else "",
        limits={str(name): float(value) for name, value in content.get("limits", {}).items()},
        settings=Settings(
            **{name: content[name] for name in _FLAGS if name in content}, mapping=content.get("map", {})
        ),
    )
    if bool(manifest.logs) == bool(manifest.table):
        raise RequestError(f"{path}: either 'logs' or 'table' was expected")
    return manifest


def _check(path: str, content: Mapping[str, Any]) -> None:
    kinds: dict[str, tuple[type, ...]] = {
        **dict.fromkeys(_LISTS, (list, str)), **dict.fromkeys(_TABLES, (dict,)),
        **dict.fromkeys(_FLAGS, (bool,)), **dict.fromkeys(_TEXTS, (str,)),
    }  # fmt: skip
    for name, value in content.items():
        if name not in kinds:
            raise RequestError(f"{path}: unknown key '{name}'{nearest(name, kinds)} (known: {', '.join(kinds)})")
        inside = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
        expected = (int, float) if name == "limits" else (str,)
        if not isinstance(value, kinds[name]) or not all(isinstance(one, expected) for one in inside):
            raise RequestError(f"{path}: '{name}' is of the wrong type; see docs/fleet.md")
    if content.get("time", "path") not in _TIMES:
        raise RequestError(f"{path}: time = '{content['time']}' (known: {', '.join(_TIMES)})")


def manifest_of(
    folder: str | os.PathLike[str], design: str | os.PathLike[str], results: str | os.PathLike[str] = "results"
) -> Manifest:
    """Return the manifest of a folder of logs with one design; axis and time are guessed from the paths.

    Parameters
    ----------
    folder, design, results : path

    Returns
    -------
    Manifest
    """
    return Manifest(logs=(os.fspath(folder),), design=os.fspath(design), results=os.fspath(results))


def items_of(manifest: Manifest) -> tuple[Item, ...]:
    """Return what is to be evaluated, by axis and time.

    Parameters
    ----------
    manifest : Manifest

    Returns
    -------
    tuple of Item

    Raises
    ------
    NoLogError
        When there is no log.
    RequestError
        When no path matches the pattern, or an axis has no design.
    """
    items = sorted(
        _listed(manifest) if manifest.table else _found(manifest), key=lambda one: (one.axis, one.time, one.files)
    )
    if not items:
        raise NoLogError("fleet: no log was found")
    if not manifest.settings.joint:
        return tuple(items)
    by_axis: dict[tuple[str, str, str], list[Item]] = {}
    for one in items:
        by_axis.setdefault((one.axis, one.type, one.design), []).append(one)
    return tuple(
        replace(of_axis[-1], files=tuple(file for one in of_axis for file in one.files)) for of_axis in by_axis.values()
    )


def _found(manifest: Manifest) -> Iterator[Item]:
    pattern = compiled(manifest.path) if manifest.path else None
    if pattern is not None and manifest.time == "path" and "time" not in pattern.groupindex:
        raise RequestError(f'path = \'{manifest.path}\': no {{time}} in it; add time = "modified" or time = "column"')
    files = list(_files(manifest.logs))
    matched = pattern is None or not files
    for root, path, name in files:
        place = pattern.place(path) if pattern is not None else guessed(path, root)
        if place is not None:
            matched = True
            yield _item(manifest, name, place)
        else:  # one foreign file must not end a run
            problem = f"{name}: does not match path = '{manifest.path}'"
            yield Item((name,), UNKNOWN, "", changed(name), "", problem)
    if not matched:
        raise RequestError(f"path = '{manifest.path}': no file matches this pattern")


def _files(logs: Sequence[str]) -> Iterator[tuple[PurePath, PurePath, str]]:
    """Yield every file once: the folder that its name is read relative to, its path, and its whole name."""
    seen: set[str] = set()
    for one in logs:
        for root, path, name in _elsewhere(one) if is_remote(one) else _here(plain(one)):
            if name not in seen:
                seen.add(name)
                yield root, path, name


def _elsewhere(one: str) -> list[tuple[PurePath, PurePath, str]]:
    """Return what a remote path means; of a folder or a pattern the files that can be logs."""
    found = listed(one)
    exact = len(found) == 1 and found[0][2].rstrip("/") == one.rstrip("/")
    return [row for row in found if exact or (row[1].suffix.lower() in SUFFIXES and not row[1].name.startswith("."))]


def _here(one: str) -> list[tuple[PurePath, PurePath, str]]:
    root = Path(one)
    inside, top = (_below(root), root) if root.is_dir() else (_matching(one), _fixed_part(one))
    return [(top, path, str(path)) for path in inside]


def _matching(pattern: str) -> list[Path]:
    try:
        return log_files([pattern])
    except LogError:  # there may be other patterns, and a log may come
        return []


def _fixed_part(pattern: str) -> Path:
    """Return the folder in front of the first wildcard."""
    parts = Path(pattern).parts
    fixed = next((k for k, part in enumerate(parts) if re.search(r"[*?\[]", part)), len(parts) - 1)
    return Path(*parts[:fixed])


def _below(folder: Path) -> list[Path]:
    found = (Path(top) / name for top, _, names in os.walk(folder) for name in names if not name.startswith("."))
    return sorted(path for path in found if path.suffix.lower() in SUFFIXES)


def _item(manifest: Manifest, name: str, place: Place) -> Item:
    time = place.time if manifest.time == "path" else None
    if manifest.time == "column":
        from pmsm_ctrl.fleet.paths import first_date

        time = first_date(name)
    design = _design_of(manifest, place.axis, place.type)
    return Item((name,), place.axis, place.type, time or changed(name), design)


def _design_of(manifest: Manifest, axis: str, kind: str) -> str:
    design = manifest.designs.get(axis) or manifest.designs.get(kind) or manifest.design
    if not design:
        raise RequestError(f"axis '{axis}': no design; 'design', or an entry '{axis}' in [designs] was expected")
    return design


def _listed(manifest: Manifest) -> Iterator[Item]:
    """Yield the items of a table; its files are relative to it."""
    folder = Path(manifest.table).parent
    for line, row in _rows(manifest.table):
        axis, kind = row["axis"], row.get("type") or ""
        name = row["file"] if is_remote(row["file"]) else str(folder / plain(row["file"]))
        if not is_file(name):
            raise RequestError(f"{manifest.table}, line {line}: no file '{row['file']}'")
        place = Place(axis, kind, _moment(row["time"], f"{manifest.table}, line {line}") if row.get("time") else None)
        one = replace(manifest, designs={axis: str(folder / row["design"])}) if row.get("design") else manifest
        yield _item(one, name, place)


def _rows(table: str) -> Iterable[tuple[int, dict[str, str]]]:
    try:
        with open(table, encoding="utf-8-sig", newline="") as stream:
            rows = list(csv.DictReader(stream))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise RequestError(f"{table}: cannot be read ({getattr(error, 'strerror', None) or error})") from None
    for line, row in enumerate(rows, start=2):
        if not row.get("file") or not row.get("axis"):
            raise RequestError(f"{table}, line {line}: 'file' and 'axis' were expected")
        yield line, row


def _moment(text: str, where: str) -> datetime:
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise RequestError(f"{where}: time '{text}'; ISO 8601 was expected, such as 2026-03-01T22:15:00") from None
    return moment if moment.tzinfo else moment.replace(tzinfo=UTC)
