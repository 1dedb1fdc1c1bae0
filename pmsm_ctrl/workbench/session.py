"""A session: what one page has been told, in a folder of its own; every file is written atomically."""

from __future__ import annotations

import json
import os
import re
import secrets
import shutil
import time
from collections.abc import Mapping, Set
from itertools import count
from pathlib import Path
from typing import Any

from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.files import write_text

__all__ = ["Session", "Sessions", "default_folder", "needed", "unlike"]

SCHEMA = "pmsm-ctrl/workbench/2"
_ID = re.compile(r"[a-z0-9]{12}")
_SUFFIX = re.compile(r"\.[A-Za-z0-9]{1,9}")  # of an uploaded file; nothing else of its name reaches the disk
STATE = "session.json"


def default_folder() -> Path:
    """Return where sessions are kept: ``pmsm_ctrl/workbench`` in the user's folder for the state of programs.

    Returns
    -------
    Path
    """
    home = os.environ.get("XDG_STATE_HOME") or os.environ.get("LOCALAPPDATA") or Path.home() / ".local" / "state"
    return Path(home) / "pmsm_ctrl" / "workbench"


class Session:
    """What one page has been told, and what was computed for it.

    Parameters
    ----------
    folder : Path
        Its name is the id of the session; it is made with the first change.

    Attributes
    ----------
    state : dict
        Plain values, as they stand in ``session.json``.
    revision : int
        Grows with every change, so that a page asks for what is new.
    job : dict or None
        What is being computed: ``kind``, ``share``, ``models``.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.revision = 1
        self.job: dict[str, Any] | None = None
        self.message = ""
        self.state: dict[str, Any] = {
            "schema": SCHEMA, "created": time.time(), "design": None, "logs": [], "steps": [], "model": None, "next": 1,
        }  # fmt: skip
        path = folder / STATE
        if path.is_file():
            try:
                found = json.loads(path.read_text(encoding="utf-8"))
            except (OSError, ValueError):
                found = {}
            if isinstance(found, dict) and found.get("schema") == SCHEMA:
                self.state |= found

    @property
    def id(self) -> str:
        """The name of its folder."""
        return self.folder.name

    def changed(self, **values: Any) -> None:
        """Change the state, and write it where there is something to keep.

        Parameters
        ----------
        **values : object
            Entries of `state`.
        """
        text = json.dumps(self.state | values, allow_nan=False)  # refused before it is part of the state
        self.state |= values
        self.revision += 1
        self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        write_text(self.folder / STATE, text)

    def touched(self) -> None:
        """Count a change of what is not kept, such as a progress."""
        self.revision += 1

    def log(self, identifier: str) -> dict[str, Any]:
        """Return the entry of a log.

        Parameters
        ----------
        identifier : str

        Returns
        -------
        dict

        Raises
        ------
        RequestError
            When there is no such log.
        """
        for entry in self.state["logs"]:
            if entry["id"] == identifier:
                found: dict[str, Any] = entry
                return found
        raise RequestError("this log is not part of the session any more; reload the page")

    def enter_log(self, identifier: str, file: str, name: str, size: int) -> None:
        """Enter a file that stands in the folder; it is not read yet. Of two logs the second one is held out.

        Parameters
        ----------
        identifier, file, name : str
        size : int
            Bytes.
        """
        logs = self.state["logs"]
        shown = unlike(name, {one["name"] for one in logs})
        entry = {
            "id": identifier, "file": file, "name": shown, "bytes": size, "mapping": {}, "window": None, "info": None,
            "role": "holdout" if [one["role"] for one in logs] == ["fit"] else "fit",
        }  # fmt: skip
        self.changed(logs=[*logs, entry], model=None, steps=[])

    def with_log(self, identifier: str, **values: Any) -> None:
        """Change the entry of a log.

        Parameters
        ----------
        identifier : str
        **values : object

        Raises
        ------
        RequestError
            When there is no such log.
        """
        self.log(identifier)
        logs = [entry | values if entry["id"] == identifier else entry for entry in self.state["logs"]]
        self.changed(logs=logs)

    def new_log(self, name: str) -> tuple[str, Path]:
        """Return the id and the place of the next file; of its name nothing but a harmless suffix is used.

        Parameters
        ----------
        name : str
            As the browser gives it.

        Returns
        -------
        (str, Path)
        """
        number = int(self.state["next"])
        self.changed(next=number + 1)
        suffix = Path(name).suffix
        identifier = f"log{number}"
        return identifier, self.folder / f"{identifier}{suffix if _SUFFIX.fullmatch(suffix) else ''}"

    def forget(self, name: str) -> None:
        """Delete a file or folder of this session.

        Parameters
        ----------
        name : str
            Made by the program, never by a browser.
        """
        target = self.folder / name
        if target.is_dir():
            shutil.rmtree(target, ignore_errors=True)
        else:
            target.unlink(missing_ok=True)

    def shown(self) -> dict[str, Any]:
        """Return what a page shows: the state, the job and the last message.

        Returns
        -------
        dict
        """
        return {**self.state, "id": self.id, "revision": self.revision, "job": self.job, "message": self.message}


def needed(asked: Mapping[str, Any], name: str) -> Any:
    """Return a value of a request.

    Parameters
    ----------
    asked : dict
    name : str

    Returns
    -------
    object

    Raises
    ------
    RequestError
        When it is missing.
    """
    if name not in asked:
        raise RequestError(f"{name}: missing in the request")
    return asked[name]


def unlike(name: str, others: Set[str]) -> str:
    """Return the name of a file, numbered where others have it: "axis (2).csv".

    The script of a session names its logs by it.

    Parameters
    ----------
    name : str
    others : set of str

    Returns
    -------
    str
    """
    stem, dot, suffix = name.rpartition(".")
    stem = stem if dot else name
    numbered = (f"{stem} ({number}){dot}{suffix if dot else ''}" for number in count(2))
    return name if name not in others else next(one for one in numbered if one not in others)


class Sessions:
    """All sessions of a folder.

    Parameters
    ----------
    folder : Path
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._open: dict[str, Session] = {}

    def new(self) -> Session:
        """Return an empty session; nothing is written yet.

        Returns
        -------
        Session
        """
        identifier = "".join(secrets.choice("abcdefghijkmnpqrstuvwxyz23456789") for _ in range(12))
        return self._open.setdefault(identifier, Session(self.folder / identifier))

    def get(self, identifier: str) -> Session:
        """Return the session of this id, an empty one where none was kept.

        Parameters
        ----------
        identifier : str

        Returns
        -------
        Session

        Raises
        ------
        RequestError
            For what is no id.
        """
        if not _ID.fullmatch(identifier):
            raise RequestError("no such session")
        found = self._open.get(identifier)
        # `kept` asks from another thread: there is one object for a session, whoever asks first
        return found if found is not None else self._open.setdefault(identifier, Session(self.folder / identifier))

    def delete(self, identifier: str) -> None:
        """Delete a session with all of its files, the copies of the logs among them.

        Parameters
        ----------
        identifier : str
        """
        session = self.get(identifier)
        self._open.pop(identifier, None)
        shutil.rmtree(session.folder, ignore_errors=True)

    def kept(self) -> list[Mapping[str, Any]]:
        """Return the sessions that can be continued, the latest first.

        Returns
        -------
        list of dict
            ``id``, ``name`` of the design, ``logs`` (their number) and ``changed`` (s since the epoch).
        """
        out: list[Mapping[str, Any]] = []
        for path in self.folder.glob(f"*/{STATE}"):
            if not _ID.fullmatch(path.parent.name):
                continue
            one = self.get(path.parent.name).state
            name = one["design"]["name"] if one["design"] else ""
            if name or one["logs"]:
                changed = path.stat().st_mtime
                out.append({"id": path.parent.name, "name": name, "logs": len(one["logs"]), "changed": changed})
        return sorted(out, key=lambda entry: -float(entry["changed"]))[:20]
