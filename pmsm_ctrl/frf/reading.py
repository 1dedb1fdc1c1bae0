"""From a file of a measured Bode diagram to what `frf` takes."""

from __future__ import annotations

import os

from pmsm_ctrl.design import Design
from pmsm_ctrl.frf.bode import read_bode
from pmsm_ctrl.frf.from_bode import MeasuredBode, interpret

__all__ = ["read_response"]


def read_response(
    path: str | os.PathLike[str], design: Design, *, kind: str | None = None, unit: str | None = None
) -> MeasuredBode:
    """Read a measured Bode diagram, for `pmsm_ctrl.frf`.

    Parameters
    ----------
    path : path
        Text: frequency with magnitude and phase, or with real and imaginary part. Of several sets that are named as
        open loop, closed loop and process the axis alone is taken first.
    design : Design
        Its loops surround the axis in an open or closed loop; its inertia tells the unit of an axis.
    kind : {"plant", "open", "closed"}, optional
        What was measured: the axis from current or torque to speed, or the speed loop.
    unit : str, optional
        Of an axis: ``(rad/s)/(N m)``, ``(rad/s)/A``, ``rpm/A``, ``rpm/A rms`` and the like.

    Returns
    -------
    MeasuredBode
        Its `doubts` say what the file does not state.

    Raises
    ------
    LogError
        When the file is no such table.
    RequestError
        For an unknown kind or unit.
    """
    return interpret(design, read_bode(path), kind=kind, unit=unit)
