"""The columns of a data frame whose names are those of channels."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.units import UNITS

__all__ = ["columns_of"]


def columns_of(frame: Any, units: Mapping[str, str]) -> dict[str, NDArray[np.float64]]:
    """Return the channels of a data frame in SI units.

    Parameters
    ----------
    frame : pandas or polars data frame, or mapping of name to array
        Without a column ``t`` a time index of pandas is the time, from 0 s.
    units : dict of channel to SI unit
        Other columns do not count.

    Returns
    -------
    dict of channel to array, shape (n,)

    Raises
    ------
    LogError
        For a unit that does not belong to its channel.
    """
    channels = {}
    for label in list(frame.columns) if hasattr(frame, "columns") else list(frame):
        name, _, unit = (part.strip() for part in str(label).rstrip("] ").partition("["))
        if name not in units:
            continue
        own = units[name]
        found, factor = UNITS.get(unit, ("", 0.0)) if unit and unit != own else (own, 1.0)
        if found != own:
            raise LogError(f"column '{label}': {own} or a unit that converts to it was expected")
        channels[name] = np.asarray(frame[label], dtype=np.float64) * factor
    index = getattr(frame, "index", None)
    if "t" not in channels and index is not None and hasattr(index, "to_numpy"):
        stamps = np.asarray(index.to_numpy())
        if stamps.dtype.kind in "mM":
            channels["t"] = (stamps - stamps[0]) / np.timedelta64(1, "ns") * 1e-9
        elif str(getattr(index, "name", "")).split(" [")[0] == "t":
            channels["t"] = stamps.astype(np.float64)
    return channels
