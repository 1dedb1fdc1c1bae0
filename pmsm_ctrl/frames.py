"""The columns of a data frame whose names are those of channels, and a log as what packages of frames take."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.units import UNITS

__all__ = ["UnchangeableDict", "columns_of", "index_of", "labels_of", "stated_unit"]


class UnchangeableDict(dict[str, NDArray[np.float64]]):
    """A dictionary that refuses changes, and is equal to itself alone.

    The constructor of a pandas data frame takes columns from dictionaries, and from no other mapping.
    """

    __slots__ = ()
    __eq__ = object.__eq__
    __ne__ = object.__ne__
    __hash__ = object.__hash__  # type: ignore[assignment]

    def _refuse(self, *_: Any, **__: Any) -> Any:
        """Refuse: what a log holds is not changed.

        Parameters
        ----------
        *_, **__
            Not looked at.

        Raises
        ------
        TypeError
            Always.
        """
        raise TypeError("a log cannot be changed: log.with_channels(omega=values) returns another one")

    __setitem__ = __delitem__ = __ior__ = _refuse
    clear = pop = popitem = setdefault = update = _refuse


def labels_of(frame: Any) -> list[Any]:
    """Return the names of the columns of a data frame or mapping; of an xarray data set its coordinates as well.

    Parameters
    ----------
    frame : data frame, xarray data set or mapping

    Returns
    -------
    list
    """
    for name in ("column_names", "columns"):
        if (found := getattr(frame, name, None)) is not None:
            return list(found)
    return list(frame.variables if hasattr(frame, "data_vars") else frame)


def stated_unit(column: Any) -> str:
    """Return the unit that a variable of xarray carries, by the convention of netCDF; empty for other columns.

    Parameters
    ----------
    column : array or variable

    Returns
    -------
    str
    """
    attributes = getattr(column, "attrs", None)
    units = attributes.get("units") if isinstance(attributes, dict) else None
    return units if isinstance(units, str) else ""


def columns_of(frame: Any, units: Mapping[str, str]) -> dict[str, NDArray[np.float64]]:
    """Return the channels of a data frame in SI units.

    Parameters
    ----------
    frame : pandas or polars data frame, xarray data set, or mapping of name to array
        Without a column ``t`` a time index of pandas is the time, from 0 s.
    units : dict of channel to SI unit
        Other columns do not count.

    Returns
    -------
    dict of channel to array, shape (n,)

    Raises
    ------
    LogError
        For a unit that does not belong to its channel, and for what is no number.
    """
    channels = {}
    for label in labels_of(frame):
        unit = stated_unit(frame[label]) if "[" not in str(label) else ""
        name, factor = _meaning(f"{label} [{unit}]" if unit else label, units)
        if name:
            channels[name] = _numbers(label, frame[label]) * factor
    label, stamps = index_of(frame)
    if "t" not in channels and stamps is not None:
        if stamps.dtype.kind in "mM":
            channels["t"] = (stamps - stamps[:1]) / np.timedelta64(1, "ns") * 1e-9
        elif label is not None and (factor := _meaning(label, {"t": units["t"]})[1]):
            channels["t"] = _numbers(label, stamps) * factor
    return channels


def index_of(frame: Any) -> tuple[Any, NDArray[Any] | None]:
    """Return the name and the values of the index of a pandas data frame, times without a zone; None for other frames.

    Parameters
    ----------
    frame : data frame

    Returns
    -------
    (object, array of shape (n,) or None)
    """
    index = getattr(frame, "index", None)
    if index is None or not hasattr(index, "to_numpy"):
        return None, None
    plain = index.tz_convert(None) if getattr(index, "tz", None) is not None else index
    return getattr(index, "name", None), np.asarray(plain.to_numpy())


def _meaning(label: Any, units: Mapping[str, str]) -> tuple[str, float]:
    """Return the channel of a label and the factor to its SI unit; ("", 0.0) for what is no channel."""
    name, _, unit = (part.strip() for part in str(label).rstrip("] ").partition("["))
    if name not in units:
        return "", 0.0
    own = units[name]
    found, factor = UNITS.get(unit, ("", 0.0)) if unit and unit != own else (own, 1.0)
    if found != own:
        raise LogError(f"column '{label}': {own} or a unit that converts to it was expected")
    return name, factor


def _numbers(label: Any, values: Any) -> NDArray[np.float64]:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise LogError(f"column '{label}': numbers were expected") from None
