"""What is done is not done again: a key made from the logs, the design, the settings and the package.

The hash of a file is remembered with its size and its time of change, so that a run with nothing new reads no log.
Where an object store states a tag of the content, that stands for the hash: the log does not pass through this process.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Mapping
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.files import sha256
from pmsm_ctrl.fleet.manifest import Item, Settings
from pmsm_ctrl.fleet.remote import digest_of, is_remote, version

__all__ = ["Hashes", "key_of", "package_digest"]

# Rooms and modules that show, ask or write, and change no number of a result.
SHOWING = frozenset(
    {"report", "rendering", "workbench", "export", "compensate", "cli.py", "console.py", "log_commands.py",
     "options.py", "next_steps.py", "init.py", "gates.py", "acceptance.py", "schemas.py", "__main__.py"}
)  # fmt: skip
OF_FLEET = frozenset({"evaluate.py", "keys.py"})
# A file that was changed within so short a time before it was hashed may change again with the same time stamp.
SETTLED = 2.0  # s


@cache
def package_digest() -> str:
    """Return a hash of every source that can change a number; the version stands in one of them."""
    root = Path(__file__).parents[1]
    made = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        parts = path.relative_to(root).parts
        counts = path.name in OF_FLEET if parts[0] == "fleet" else parts[0] not in SHOWING
        if counts and path.name not in ("present.py", "figures.py"):
            made.update("/".join(parts).encode() + path.read_bytes())
    return made.hexdigest()


class Hashes:
    """Hashes of files, remembered by size and time of change.

    Parameters
    ----------
    known : dict of path to [size, ns, hash, s], optional
        From an earlier run.
    """

    def __init__(self, known: Mapping[str, Any] | None = None) -> None:
        self.known: dict[str, Any] = dict(known or {})

    def __call__(self, path: str) -> str:
        """Return the SHA-256 of a file; of an object the tag of its content, where its store states one.

        Parameters
        ----------
        path : str

        Raises
        ------
        OSError
            When it cannot be read.
        """
        if is_remote(path):
            return self._of_object(path)
        about = os.stat(path)
        size, changed, digest, when = (self.known.get(path) or (None, None, "", 0.0))[:4]
        if (size, changed) == (about.st_size, about.st_mtime_ns) and when - 1e-9 * about.st_mtime_ns > SETTLED:
            return str(digest)
        now, digest = time.time(), sha256(path)
        self.known[path] = [about.st_size, about.st_mtime_ns, digest, now]
        return digest

    def _of_object(self, path: str) -> str:
        size, written, content = version(path)
        if content:
            return f"{size} {content}"
        if self.known.get(path, (None, None))[:2] != [size, written]:
            self.known[path] = [size, written, digest_of(path), time.time()]
        return str(self.known[path][2])


def _design_digest(path: str) -> str:
    try:
        return sha256(path)
    except OSError as error:
        raise RequestError(f"{path}: no design can be read here ({error.strerror})") from None


def key_of(item: Item, settings: Settings, hashes: Hashes, effects: str = "") -> str:
    """Return the key of what is evaluated: equal keys give equal rows.

    Parameters
    ----------
    item : Item
    settings : Settings
    hashes : Hashes
    effects : str
        Hash of the file with own effects; empty where there is none.

    Returns
    -------
    str
        32 hexadecimal digits.
    """
    logs = []
    for path in item.files:
        try:
            logs.append(hashes(path))
        except OSError as error:  # is evaluated, fails, and is tried again when it can be read
            logs.append(f"unreadable {error.errno}")
    content = {
        "logs": logs, "design": _design_digest(item.design) if item.design else "", "settings": asdict(settings),
        "package": package_digest(), "axis": item.axis, "type": item.type, "time": item.time.isoformat(),
        "files": item.files, "problem": item.problem, "effects": effects,
    }  # fmt: skip
    return hashlib.sha256(json.dumps(content, sort_keys=True, default=dict).encode()).hexdigest()[:32]
