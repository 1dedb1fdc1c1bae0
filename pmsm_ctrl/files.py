"""Atomic writing of files: a reader sees the old content or the new one."""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
import tempfile
import time
import unicodedata
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path

from pmsm_ctrl.errors import RequestError, nearest

__all__ = [
    "atomic_path", "example_design", "example_designs", "printable", "read_text", "require_distinct", "require_new",
    "require_writable", "sha256", "unused_name", "write_text",
]  # fmt: skip

# A killed process leaves its temporary file. No command writes for a day, so that older ones can be deleted.
STALE = 86400.0
LARGEST_TEXT = 64 << 20  # bytes, of what is read whole
# Files that this command found free, and has not written yet: another one may write them in the meantime.
FOUND_FREE: set[Path] = set()
# Unicode's categories of controls, marks of direction and other formats, halves of pairs, line and paragraph ends.
COMMANDS = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})


def example_designs() -> dict[str, Path]:
    """Return the designs that come with the package by name; in a working copy of the project they stand beside it.

    Returns
    -------
    dict of name to Path
    """
    package = Path(__file__).resolve().parent
    folder = next((place for place in (package / "examples", package.parent / "designs") if place.is_dir()), package)
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def example_design(name: str) -> Path:
    """Return the file of a design that comes with the package.

    Parameters
    ----------
    name : str

    Returns
    -------
    Path

    Raises
    ------
    RequestError
        For an unknown name; the known ones are said.
    """
    known = example_designs()
    if name not in known:
        raise RequestError(f"example '{name}': no such design{nearest(name, known)} (known: {', '.join(known)})")
    return known[name]


def printable(text: object) -> str:
    """Return a text without characters that command a terminal: controls and marks of direction, line feeds apart.

    A file may be named by anybody, and its name stands in what is printed.

    Parameters
    ----------
    text : str or path

    Returns
    -------
    str
        With U+FFFD in their place.
    """
    return "".join(c if c == "\n" or unicodedata.category(c) not in COMMANDS else "\ufffd" for c in str(text))


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary name beside `path`; rename it to `path` when the block ends without error.

    A link is followed, a file's permissions are kept, and a device or pipe is written to, not replaced. A file that
    `require_new` found free and that is there now is another command's: the content gets the next free name.

    Parameters
    ----------
    path : path
        The file to write.

    Yields
    ------
    Path
        Where to write it.

    Raises
    ------
    RequestError
        When the folder does not exist or cannot be written, or the disk is full; when another command has written the
        file in the meantime.
    """
    require_writable(path)
    target = Path(os.path.realpath(path))
    stream = target.exists() and not target.is_file()  # /dev/stdout, a named pipe
    folder = Path(tempfile.gettempdir()) if stream else target.parent
    prefix, suffix = f".{target.name[:100]}.", ".part"
    try:
        handle, name = tempfile.mkstemp(prefix=prefix, suffix=suffix, dir=folder)
    except OSError as error:
        raise RequestError(f"{path}: cannot write here ({error.strerror})") from None
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        if stream:
            with open(temporary, "rb") as source, open(target, "wb") as sink:
                shutil.copyfileobj(source, sink)
        else:
            place = unused_name(target) if target in FOUND_FREE and _occupied(target) else target
            temporary.chmod(_mode(target))
            os.replace(temporary, place)
            FOUND_FREE.discard(target)
            _sweep(folder, prefix, suffix)
            if place != target:
                raise RequestError(f"{path}: another command has written it meanwhile; this one's is {place.name}")
    except OSError as error:
        if isinstance(error, BrokenPipeError):
            raise
        raise RequestError(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        with suppress(FileNotFoundError):
            temporary.unlink()


def require_writable(path: str | os.PathLike[str]) -> None:
    """Refuse a path that cannot be written, before the computation of its content.

    Parameters
    ----------
    path : path

    Raises
    ------
    RequestError
        When `path` is a folder, or its folder does not exist or cannot be written.
    """
    try:
        target = Path(os.path.realpath(path))
        if target.is_dir():
            raise RequestError(f"{path}: is a folder; a file name was expected")
        if not target.parent.is_dir():
            raise RequestError(f"{path}: cannot write here (no folder '{Path(path).parent}')")
        occupied = target if target.exists() and not target.is_file() else target.parent
        if not os.access(occupied, os.W_OK):
            raise RequestError(f"{path}: cannot write here (permission denied)")
    except (OSError, ValueError) as error:  # a name with a zero byte, or longer than the system allows
        raise RequestError(f"{path}: cannot write here ({getattr(error, 'strerror', None) or error})") from None


def require_distinct(outputs: Iterable[Path], inputs: Iterable[Path]) -> None:
    """Refuse an output that is an input, or that is named twice, by whatever name or link.

    Parameters
    ----------
    outputs, inputs : iterable of Path

    Raises
    ------
    RequestError
        For the first output that would overwrite another file of the same command.
    """
    read = list(inputs)
    written: list[Path] = []
    for output in outputs:
        if any(_same(output, one) for one in read):
            raise RequestError(f"{output}: is an input of this command and would be overwritten; name another file")
        if any(_same(output, one) for one in written):
            raise RequestError(f"{output}: is given for two outputs; name another file for one of them")
        written.append(output)


def require_new(outputs: Iterable[Path]) -> None:
    """Refuse an output that exists and holds something; an empty file, a device and a pipe may be written to.

    Parameters
    ----------
    outputs : iterable of Path

    Raises
    ------
    RequestError
        For the first file that would be overwritten.
    """
    for output in outputs:
        try:
            occupied = _occupied(output)
        except (OSError, ValueError):  # what cannot be looked at is refused where it is written
            continue
        if occupied:
            raise RequestError(f"{output}: exists; --force overwrites it, or name another file")
        FOUND_FREE.add(Path(os.path.realpath(output)))


def _occupied(output: Path) -> bool:
    return output.is_file() and output.stat().st_size > 0


def unused_name(path: Path) -> Path:
    """Return `path`, or where it exists the first of ``NAME-2``, ``NAME-3``... that does not.

    Parameters
    ----------
    path : Path

    Returns
    -------
    Path
        In the same folder, with the same suffix.
    """
    names = (path.with_name(f"{path.stem}-{k}{path.suffix}") for k in count(2))
    return path if not path.exists() else next(name for name in names if not name.exists())


def _same(one: Path, other: Path) -> bool:
    """Whether two names mean one regular file; a device such as /dev/null may be given twice."""
    try:
        if one.exists() and other.exists():
            return one.is_file() and os.path.samefile(one, other)
        return os.path.realpath(one) == os.path.realpath(other)
    except (OSError, ValueError):  # what cannot be looked at is refused where it is read or written
        return False


def _mode(target: Path) -> int:
    """Permissions of the file that is replaced, or those that a new file gets here."""
    if target.exists():
        return target.stat().st_mode & 0o777
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask


def _sweep(folder: Path, prefix: str, suffix: str) -> None:
    """Remove temporary files of killed processes that wrote the same file."""
    with suppress(OSError):
        for name in os.listdir(folder):
            if name.startswith(prefix) and name.endswith(suffix):
                left = folder / name
                if time.time() - left.stat().st_mtime > STALE:
                    left.unlink()


def read_text(path: str | os.PathLike[str]) -> str:
    """Return the text of a file that is read whole, UTF-8; a pipe would be waited for, and a device has no end.

    Parameters
    ----------
    path : path

    Returns
    -------
    str

    Raises
    ------
    OSError
        When the file cannot be read, is a device or a pipe, or is larger than `LARGEST_TEXT`.
    UnicodeDecodeError
        When it is not text.
    """
    target = Path(path)
    if target.exists() and not (target.is_file() or target.is_dir()):
        raise OSError(errno.EINVAL, "a device or a pipe, not a file")
    if target.stat().st_size > LARGEST_TEXT:
        raise OSError(errno.EFBIG, f"larger than {LARGEST_TEXT >> 20} MB")
    return target.read_text(encoding="utf-8")


def write_text(path: str | os.PathLike[str], text: str) -> Path:
    """Write `text` to `path` as UTF-8, atomically, and return the path.

    Bytes of a file's name that are no UTF-8 are written as JSON escapes them.

    Parameters
    ----------
    path : path
    text : str

    Returns
    -------
    Path
        The same path.
    """
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="backslashreplace")
    return Path(path)


def sha256(path: str | os.PathLike[str]) -> str:
    """Return the SHA-256 of a file's bytes as hexadecimal text.

    Parameters
    ----------
    path : path

    Returns
    -------
    str
    """
    digest = hashlib.sha256()
    with open(path, "rb") as stream:
        while block := stream.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()
