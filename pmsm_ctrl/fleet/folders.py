"""Folders of results, on this machine or in a store that fsspec reaches: whole files by name, one level deep."""

from __future__ import annotations

import os
from pathlib import Path, PurePosixPath
from typing import Any, Protocol

from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.files import atomic_path
from pmsm_ctrl.fleet.remote import OBJECTS, filesystem, is_remote, plain, reached

__all__ = ["Folder", "LocalFolder", "RemoteFolder", "folder_at"]


class Folder(Protocol):
    """Where the results are: whole files by name, one level deep."""

    name: str
    arrow: Any  # file system for pyarrow; None for that of this machine

    def exists(self) -> bool:
        """Whether it is there."""

    def occupied(self) -> bool:
        """Whether it holds anything."""

    def make(self) -> None:
        """Make it, with the folders above."""

    def names(self) -> list[str]:
        """Return the names of its files."""

    def path(self, name: str) -> str:
        """Return the path of a file for pyarrow."""

    def write(self, name: str, content: bytes) -> None:
        """Write a file; a reader sees it whole or not at all."""

    def read(self, name: str) -> bytes:
        """Return a file's content."""

    def remove(self, name: str) -> None:
        """Remove a file, if it is there."""


class LocalFolder:
    """A folder of this machine.

    Parameters
    ----------
    name : path
    """

    arrow = None

    def __init__(self, name: str | os.PathLike[str]) -> None:
        self.name, self._path = os.fspath(name), Path(name)

    def exists(self) -> bool:
        """Whether it is there."""
        return self._path.is_dir()

    def occupied(self) -> bool:
        """Whether it holds anything."""
        return self.exists() and any(self._path.iterdir())

    def make(self) -> None:
        """Make it, with the folders above."""
        self._path.mkdir(parents=True, exist_ok=True)

    def names(self) -> list[str]:
        """Return the names of its files; one that is not whole yet is hidden."""
        return [one.name for one in self._path.iterdir() if not one.name.startswith(".")]

    def path(self, name: str) -> str:
        """Return the path of a file for pyarrow.

        Parameters
        ----------
        name : str
        """
        return str(self._path / name)

    def write(self, name: str, content: bytes) -> None:
        """Write a file under a temporary name and rename it.

        Parameters
        ----------
        name : str
        content : bytes
        """
        with atomic_path(self._path / name) as temporary:
            temporary.write_bytes(content)

    def read(self, name: str) -> bytes:
        """Return a file's content.

        Parameters
        ----------
        name : str
        """
        return (self._path / name).read_bytes()

    def remove(self, name: str) -> None:
        """Remove a file, if it is there.

        Parameters
        ----------
        name : str
        """
        (self._path / name).unlink(missing_ok=True)


class RemoteFolder:
    """A prefix in an object store, or a folder that fsspec reaches; a file is written as one object.

    Parameters
    ----------
    name : str
        With its protocol.

    Raises
    ------
    RequestError
        As for `filesystem`.
    """

    def __init__(self, name: str) -> None:
        self.name = name.rstrip("/")
        self.arrow, self._path = filesystem(self.name)

    def exists(self) -> bool:
        """Whether it is there; a store of objects has a folder once something is in it."""
        with reached(self.name):
            return bool(self.arrow.exists(self._path))

    def occupied(self) -> bool:
        """Whether it holds anything."""
        with reached(self.name):
            return self.exists() and bool(self.arrow.ls(self._path, detail=False))

    def make(self) -> None:
        """Make it, with the folders above; a store of objects needs none."""
        if self.name.partition("://")[0] not in OBJECTS:
            with reached(self.name):
                self.arrow.makedirs(self._path, exist_ok=True)

    def names(self) -> list[str]:
        """Return the names of its files."""
        with reached(self.name):
            self.arrow.invalidate_cache(self._path)
            try:
                found = self.arrow.ls(self._path, detail=False)
            except FileNotFoundError:  # no object has this prefix yet
                return []
            return [PurePosixPath(one).name for one in found]

    def path(self, name: str) -> str:
        """Return the path of a file for pyarrow.

        Parameters
        ----------
        name : str
        """
        return f"{self._path}/{name}"

    def write(self, name: str, content: bytes) -> None:
        """Write a file as one object.

        Parameters
        ----------
        name : str
        content : bytes

        Raises
        ------
        RequestError
            When the store refuses it.
        """
        try:
            with reached(self.name):
                self.arrow.pipe_file(self.path(name), content)
        except OSError as error:
            raise RequestError(f"{self.name}/{name}: cannot be written ({error.strerror or error})") from None

    def read(self, name: str) -> bytes:
        """Return a file's content.

        Parameters
        ----------
        name : str
        """
        with reached(self.name):
            return bytes(self.arrow.cat_file(self.path(name)))

    def remove(self, name: str) -> None:
        """Remove a file, if it is there.

        Parameters
        ----------
        name : str
        """
        with reached(self.name):
            try:
                self.arrow.rm_file(self.path(name))
            except FileNotFoundError:  # somebody else has
                return


def folder_at(name: str | os.PathLike[str]) -> LocalFolder | RemoteFolder:
    """Return the folder of a path, here or elsewhere.

    Parameters
    ----------
    name : path

    Returns
    -------
    LocalFolder or RemoteFolder

    Raises
    ------
    RequestError
        As for `filesystem`.
    """
    return RemoteFolder(os.fspath(name)) if is_remote(name) else LocalFolder(plain(name))
