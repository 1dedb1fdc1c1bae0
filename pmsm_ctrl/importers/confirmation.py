"""Doubts about a unit or a sign decide: a log with one is not evaluated until somebody has confirmed the unit."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.names import split_header
from pmsm_ctrl.importers.notices import SPEED_FACTOR, TORQUE_FACTOR, TORQUE_SIGN, UNIT_ASSUMED, UNLIKELY_INERTIA
from pmsm_ctrl.log import Log
from pmsm_ctrl.section import Notice

__all__ = ["of_written", "require_confirmed", "unconfirmed"]

# Times the design's inertia; less is a load that the design does not know.
INERTIA = 3.0
NOTHING = 1e-12  # SI; that is no torque at all, which is said elsewhere


def require_confirmed(log: Log, design: Design | None, mapping: Mapping[str, str] | None) -> None:
    """Refuse a log whose import doubts a factor or a sign, unless a mapping states the channel's unit.

    Parameters
    ----------
    log : Log
        As it was read.
    design : Design, optional
        Its [log] table may state units.
    mapping : mapping of str to str, optional
        Channel to column, as `read_log` takes it.

    Raises
    ------
    LogError
        In one line: the doubt, and how to correct or confirm the unit. Also for a number beyond reason.
    """
    log.check_evaluable(1)
    for notice, name in unconfirmed(log, design, mapping):
        label = f"{log.provenance.file}: " if log.provenance.file else ""
        minus = f"--map {name}='-COLUMN [{log.unit(name)}]' turns its sign, and "
        raise LogError(
            f"{label}{notice.text}; --map {name}='COLUMN [{notice.detail.get('time') or 'UNIT'}]' corrects the unit, "
            f"{minus if notice.code == TORQUE_SIGN.code else ''}"
            f"--map {name}='COLUMN [{log.unit(name)}]' confirms it"
        )


def unconfirmed(log: Log, design: Design | None, mapping: Mapping[str, str] | None) -> list[tuple[Notice, str]]:
    """Return the doubts of a factor or a sign that no stated unit has settled, each with the channel it concerns.

    Parameters
    ----------
    log, design, mapping
        As `require_confirmed`.

    Returns
    -------
    list of (Notice, str)
    """
    stated = {**(design.log.channels if design is not None else {}), **(mapping or {})}
    scaled = design.log.scale if design is not None else {}
    sure = {name for name, column in stated.items() if split_header(column)[1] or name in scaled}
    doubts = ((notice, _concerned(notice, log)) for notice in log.provenance.notices)
    return [(notice, channels[-1]) for notice, channels in doubts if channels and not sure & set(channels)]


def of_written(log: Log, design: Design | None, mapping: Mapping[str, str]) -> tuple[str, list[str]]:
    """Return what is still to be stated of the canonical file that a log is written to, which keeps no confirmation.

    Parameters
    ----------
    log, design
        As `require_confirmed`.
    mapping : mapping of str to str
        What somebody has stated, channel by channel; a proposal that was taken as a whole is not.

    Returns
    -------
    (str, list of str)
        A channel whose unit has to be corrected first, empty where there is none, and the mappings of the others:
        they turn a sign that nobody has confirmed.
    """
    again = [one for one in unconfirmed(log, design, {}) if one[0].code != UNIT_ASSUMED.code]
    open_ones = {name: notice for notice, name in unconfirmed(log, design, mapping)}
    wrong = next((name for _, name in again if name in open_ones and open_ones[name].code != TORQUE_SIGN.code), "")
    signs = {name: "-" if name in open_ones else "" for _, name in again}
    return wrong, [f"{name}={sign}{name} [{log.unit(name)}]" for name, sign in signs.items()]


def _concerned(notice: Notice, log: Log) -> tuple[str, ...]:
    """Return the channels that a doubt of a unit or a sign concerns, the likeliest last; none for any other notice."""
    if notice.code == UNIT_ASSUMED.code:  # a current in A is what nearly every drive writes
        return tuple(name for name in notice.detail["channels"] if name in ("theta", "omega", "torque"))
    if notice.code == SPEED_FACTOR.code:
        return ("theta", "omega", "t") if notice.detail.get("time") else ("theta", "omega")
    if notice.code == TORQUE_FACTOR.code:
        return "i_q", "torque"
    if notice.code == TORQUE_SIGN.code:
        return "theta", "omega", str(notice.detail["channel"])
    if notice.code == UNLIKELY_INERTIA.code:
        factor, name = float(notice.detail["factor"]), str(notice.detail["channel"])
        far = not 1.0 / INERTIA <= factor <= INERTIA
        return ("theta", "omega", name) if far and float(np.max(np.abs(log[name]))) > NOTHING else ()
    return ()
