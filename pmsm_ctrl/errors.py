"""The errors of the package. Each message says what is wrong, where, and what is accepted."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from enum import Enum

__all__ = [
    "CacheWarning",
    "DesignError",
    "LogError",
    "MappingError",
    "NextCommand",
    "NotExcitedError",
    "PmsmCtrlError",
    "RequestError",
    "SimulationError",
    "UnsafeGainError",
    "nearest",
    "require_kind",
]  # fmt: skip


class NextCommand(Enum):
    """What to run after an error; the command line writes it behind the message."""

    INIT = "pmsm-ctrl init writes a design from a datasheet"
    ELECTRICAL_DATA = "pmsm-ctrl init asks for the electrical data; of a linear motor beside its pole pitch"
    INERTIA = "pmsm-ctrl identify LOG --design DESIGN --output NEW_DESIGN finds it"
    TUNE = "pmsm-ctrl tune DESIGN --output NEW_DESIGN"
    LOOPS = "K_p and T_n of the drive in [loops.current] and [loops.speed], by hand: tune needs the electrical data"
    MAP = "--map CHANNEL='COLUMN [UNIT]' names its column"
    IMPORT = "pmsm-ctrl import LOG"
    PROPOSE = "pmsm-ctrl import LOG proposes a mapping"
    EFFECTS = "pmsm-ctrl effects lists them; --effects FILE.py adds your own"
    IDENTIFY = "pmsm-ctrl identify takes a log of any motion"


class PmsmCtrlError(Exception):
    """Base of every error that the package raises on purpose; the command line prints it as one line.

    Parameters
    ----------
    message : str
        What is wrong, where, and what would have been accepted.
    next_command : NextCommand, optional
        What to run next.
    """

    def __init__(self, message: str = "", *, next_command: NextCommand | None = None) -> None:
        super().__init__(message)
        self.next_command = next_command


class DesignError(PmsmCtrlError):
    """A design file or a design object is wrong."""


class LogError(PmsmCtrlError):
    """A measured or simulated log is wrong or cannot answer the question.

    Attributes
    ----------
    proposable : bool
        Whether the columns of the file are the cause, so that another mapping may be proposed.
    """

    proposable = False


class NotExcitedError(LogError):
    """A log is sound, but its motion does not hold what was asked for."""


class MappingError(LogError):
    """Columns of a file that are no channel by themselves."""

    proposable = True


class RequestError(PmsmCtrlError):
    """A call asks for something that does not exist or cannot be done."""


class UnsafeGainError(RequestError):
    """A compensation is to be exported whose gain is not safe."""


class SimulationError(PmsmCtrlError):
    """A simulation diverged; the message gives the scenario, the time and likely causes."""


class CacheWarning(UserWarning):
    """The cache of compiled kernels is damaged or cannot be written; it costs time, not the answer."""


# How a noun comes about, for a message that found something else in its place.
READ = {
    "Design": "Design.read('axis.toml') reads one",
    "Log": "read_log('log.csv', design) reads one",
    "Mapping": "Log({'t': t, 'omega': omega, 'i_q': i_q})",
}


def require_kind(value: object, kind: type, what: str) -> None:
    """Refuse an argument that is not of this type: a path in place of a design, say.

    Parameters
    ----------
    value : object
    kind : type
    what : str
        The argument's name.

    Raises
    ------
    RequestError
        When it is of another type.
    """
    if not isinstance(value, kind):
        found = "None" if value is None else type(value).__name__
        hint = f": {READ[kind.__name__]}" if kind.__name__ in READ else ""
        raise RequestError(f"{what}: {found} found; a {kind.__name__} was expected{hint}")


def nearest(word: str, known: Iterable[str]) -> str:
    """Return ``"; did you mean 'x'?"`` for the closest known word, or an empty string.

    Parameters
    ----------
    word : str
    known : iterable of str

    Returns
    -------
    str
    """
    match = difflib.get_close_matches(word, list(known), n=1, cutoff=0.6)
    return f"; did you mean '{match[0]}'?" if match else ""
