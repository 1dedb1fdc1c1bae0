"""Errors of the libraries that read the formats, as one line each."""

from __future__ import annotations

import logging
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.table import one_line

__all__ = ["afford", "guarded", "not_installed", "reason"]


def reason(error: BaseException) -> str:
    """Return the first line of an error's message, or its name."""
    text = str(error).strip()
    return one_line(text.splitlines()[0][:120]) if text else type(error).__name__


# A log compresses ten to thirty times, with constant channels; from a hundred times on it is no log. Small files may.
EXPANSION, ALWAYS = 100.0, float(1 << 28)  # bytes per byte of the file; bytes


def afford(file: str, kind: str, values: float, path: Path) -> None:
    """Refuse a file that declares more values than it can hold or than fit into half of the memory.

    A damaged header can, and a small file can be made to unpack to any size.

    Raises
    ------
    LogError
        With what would be needed and what there is.
    """
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") if hasattr(os, "sysconf") else 1 << 33
    if 8.0 * values > 0.5 * memory:
        raise LogError(
            f"{file}: {kind} file of {values:.3g} values: {8e-9 * values:.3g} GB needed, {1e-9 * memory:.3g} GB there; "
            "the file is damaged, or has to be split into shorter records"
        )
    if 8.0 * values > max(ALWAYS, EXPANSION * path.stat().st_size):
        raise LogError(
            f"{file}: {kind} file of {values:.3g} values, {8e-6 * values:.3g} MB, in a file of "
            f"{1e-6 * path.stat().st_size:.3g} MB; the file is damaged, or was made to fill the memory"
        )


def not_installed(file: str, kind: str, library: str, extra: str) -> LogError:
    """Return the error of a format whose library is optional and missing, with the command that installs it."""
    return LogError(f"{file}: {kind} needs {library}: pip install 'pmsm-ctrl[{extra}]'")


@contextmanager
def guarded(file: str, kind: str, library: str = "") -> Iterator[None]:
    """Turn any error into a `LogError` that names the file; suppress the warnings and the log of the library.

    Parameters
    ----------
    file, kind, library : str
        File and format for the message; the library whose log is suppressed.

    Yields
    ------
    None

    Raises
    ------
    LogError
        For any error but a `LogError`, which passes.
    """
    names = [name for name in logging.root.manager.loggerDict if library and name.split(".")[0] == library]
    loggers = {logging.getLogger(name): logging.getLogger(name).level for name in names}
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except LogError:
        raise
    except MemoryError:
        raise LogError(f"{file}: damaged {kind} file, or larger than memory") from None
    except Exception as error:  # damaged bytes can raise any error in a library
        raise LogError(f"{file}: damaged or unsupported {kind} file ({reason(error)})") from None
    finally:
        for logger, level in loggers.items():
            logger.setLevel(level)
