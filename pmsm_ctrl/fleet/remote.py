"""Logs and results elsewhere: paths such as ``s3://bucket/logs``, through fsspec.

A path without ``://`` never imports fsspec, and ``file://`` is a path of this machine.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import unquote, urlsplit

from pmsm_ctrl.errors import LogError, RequestError

__all__ = [
    "OBJECTS", "changed", "digest_of", "filesystem", "head", "is_file", "is_remote", "listed", "local_copy", "plain",
    "reached", "version",
]  # fmt: skip

# Stores of objects: a folder is the beginning of a name, and making one could make a bucket.
OBJECTS = frozenset({"s3", "s3a", "gs", "gcs", "abfs", "abfss", "az"})
# What stores say of the content of an object; one that is written again has another.
CONTENT = ("ETag", "etag", "md5Hash", "content_md5", "checksum")


def is_remote(name: str | os.PathLike[str]) -> bool:
    """Whether a path names a protocol other than ``file``.

    Parameters
    ----------
    name : path
    """
    return "://" in os.fspath(name) and not os.fspath(name).startswith("file://")


def plain(name: str | os.PathLike[str]) -> str:
    """Return a path of this machine without ``file://``; any other one as it is.

    Parameters
    ----------
    name : path

    Returns
    -------
    str
    """
    text = os.fspath(name)
    return unquote(urlsplit(text).path) if text.startswith("file://") else text


def filesystem(name: str) -> tuple[Any, str]:
    """Return fsspec's file system of a path, and the path within it.

    Parameters
    ----------
    name : str
        With its protocol.

    Returns
    -------
    fsspec.AbstractFileSystem, str

    Raises
    ------
    RequestError
        When fsspec or the package of the protocol is not installed, or the protocol is unknown.
    """
    try:
        import fsspec
    except ImportError:
        raise RequestError(f"{name}: fsspec not installed: pip install 'pmsm-ctrl[remote]'") from None
    protocol = name.partition("://")[0]
    try:
        system, path = fsspec.core.url_to_fs(name)
    except ImportError as error:
        raise RequestError(f"{name}: {error}; pip install 'fsspec[{protocol}]'") from None
    except ValueError as error:
        raise RequestError(f"{name}: protocol '{protocol}' cannot be used ({error})") from None
    except Exception as error:  # credentials, addresses: whatever the store's package raises
        raise RequestError(f"{name}: cannot be reached ({_said(error)})") from None
    return system, path


def _said(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__


@contextmanager
def reached(name: str) -> Iterator[None]:
    """Turn what the package of a store raises into one line; each has errors of its own.

    Parameters
    ----------
    name : str
        With its protocol.

    Raises
    ------
    OSError
        Of what the package said.
    """
    try:
        yield
    except (OSError, RequestError):
        raise
    except Exception as error:
        raise OSError(None, _said(error), name) from error


def listed(pattern: str) -> list[tuple[PurePosixPath, PurePosixPath, str]]:
    """Return the objects of a remote file, folder or pattern, sorted.

    Parameters
    ----------
    pattern : str
        With its protocol.

    Returns
    -------
    list of (PurePosixPath, PurePosixPath, str)
        Folder that was asked for and path, both without the protocol, and the whole name.

    Raises
    ------
    RequestError
        When the store cannot be read.
    """
    system, path = filesystem(pattern)
    try:
        with reached(pattern):
            if any(sign in path for sign in "*?["):
                found = [one for one in system.glob(path) if not system.isdir(one)]
                fixed = path[: min(path.find(sign) for sign in "*?[" if sign in path)]
                root = PurePosixPath(fixed.rpartition("/")[0])
            elif system.isfile(path):
                found, root = [path], PurePosixPath(path).parent
            else:
                found, root = list(system.find(path)), PurePosixPath(path)
    except FileNotFoundError:
        return []
    except OSError as error:
        raise RequestError(f"{pattern}: cannot be listed ({error.strerror or error})") from None
    front = _in_front(pattern, path)
    return [
        (root, PurePosixPath(one), system.unstrip_protocol(one) if front is None else front + one.lstrip("/"))
        for one in sorted(found)
    ]


def _in_front(name: str, path: str) -> str | None:
    """Return what stands before the path in a name, a host say; None where the path is not the end of the name."""
    inside, whole = path.strip("/"), name.rstrip("/")
    return whole[: len(whole) - len(inside)] if whole.endswith(inside) else None


def is_file(name: str) -> bool:
    """Whether there is such a file, here or elsewhere.

    Parameters
    ----------
    name : str
    """
    if not is_remote(name):
        return Path(plain(name)).is_file()
    system, path = filesystem(name)
    with reached(name):
        return bool(system.isfile(path))


def changed(name: str) -> datetime:
    """Return when a file was changed last.

    Parameters
    ----------
    name : str

    Returns
    -------
    datetime
        UTC.

    Raises
    ------
    OSError
        When it cannot be read.
    """
    if not is_remote(name):
        return datetime.fromtimestamp(os.stat(name).st_mtime, UTC)
    system, path = filesystem(name)
    with reached(name):
        moment: datetime = system.modified(path)
    return moment if moment.tzinfo else moment.replace(tzinfo=UTC)


def version(name: str) -> tuple[int, str, str]:
    """Return what a store says of an object, without its content being read.

    Parameters
    ----------
    name : str

    Returns
    -------
    int, str, str
        Size in bytes; what changes with every writing; what stands for the content, empty where the store has none.

    Raises
    ------
    OSError
        When it cannot be read.
    """
    system, path = filesystem(name)
    with reached(name):
        about = system.info(path)
        content = next((f"{key} {about[key]}" for key in CONTENT if about.get(key)), "")
        return int(about.get("size") or 0), str(system.ukey(path)), content


def digest_of(name: str) -> str:
    """Return the SHA-256 of an object.

    Parameters
    ----------
    name : str

    Returns
    -------
    str

    Raises
    ------
    OSError
        When it cannot be read.
    """
    system, path = filesystem(name)
    made = hashlib.sha256()
    with reached(name), system.open(path, "rb") as stream:
        while block := stream.read(1 << 20):
            made.update(block)
    return made.hexdigest()


def head(name: str | os.PathLike[str], count: int) -> bytes:
    """Return the first bytes of a file, here or elsewhere.

    Parameters
    ----------
    name : path
    count : int

    Returns
    -------
    bytes

    Raises
    ------
    OSError
        When it cannot be read.
    """
    if not is_remote(name):
        with open(plain(name), "rb") as stream:
            return stream.read(count)
    system, path = filesystem(os.fspath(name))
    with reached(os.fspath(name)):
        return bytes(system.cat_file(path, start=0, end=count))


@contextmanager
def local_copy(name: str) -> Iterator[Path]:
    """Yield a file of this machine with the content of `name`; a copy is removed afterwards.

    Parameters
    ----------
    name : str
        With or without a protocol.

    Yields
    ------
    Path

    Raises
    ------
    LogError
        When it cannot be fetched.
    """
    if not is_remote(name):
        yield Path(plain(name))
        return
    with tempfile.TemporaryDirectory(prefix="pmsm_ctrl") as folder:
        system, path = filesystem(name)
        copy = Path(folder) / PurePosixPath(path).name
        try:
            with reached(name):
                system.get_file(path, str(copy))
        except OSError as error:
            raise LogError(f"{name}: cannot be fetched ({error.strerror or error})") from None
        yield copy
