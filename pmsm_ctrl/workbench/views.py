"""What a page draws: a stretch of some curves at the width of the screen, as packed doubles."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.log import CHANNELS
from pmsm_ctrl.units import UNITS
from pmsm_ctrl.workbench.curves import Curves, packed
from pmsm_ctrl.workbench.session import Session, needed

__all__ = ["VIEWS", "channels"]

Array = NDArray[np.float64]
Asked = Mapping[str, str]

DOTS = 4000  # of a scatter
BANDS = 40  # of a coordinate, each with its mean
FEWEST = 20  # samples that a mean is drawn of
MOST_MEANT = 200_000  # samples that the means are taken of: all of ten million take half a second
GOLDEN = 0.5 * (5.0**0.5 - 1.0)  # its multiples spread evenly over [0, 1)


def channels() -> list[dict[str, Any]]:
    """Return the channels that a column can be mapped to, with the units that fit.

    Returns
    -------
    list of dict
    """
    out = []
    for name, (rotary, linear, meaning) in CHANNELS.items():
        if name.endswith("_true"):
            continue
        units = [unit for unit, (si, _) in UNITS.items() if si in (rotary, linear)]
        out.append({"name": name, "meaning": meaning, "units": units})
    return out


def _number(asked: Asked, name: str) -> float | None:
    text = asked.get(name, "")
    if not text:
        return None
    try:
        value = float(text)
    except ValueError:
        raise RequestError(f"{name}: a number was expected") from None
    if not np.isfinite(value):
        raise RequestError(f"{name}: a finite number was expected")
    return value


def _stretch(asked: Asked) -> tuple[float | None, float | None, int]:
    return _number(asked, "start"), _number(asked, "stop"), int(_number(asked, "bins") or 800)


def _record(session: Session, asked: Asked) -> Mapping[str, Any]:
    model = session.state["model"]
    if model is None:
        raise RequestError("nothing was compared yet")
    number = int(_number(asked, "record") or 0)
    if not 0 <= number < len(model["records"]):
        raise RequestError("no such record")
    found: Mapping[str, Any] = model["records"][number]
    return found


def of_log(session: Session, asked: Asked) -> bytes:
    """Return channels of a log over a stretch of time.

    Parameters
    ----------
    session : Session
    asked : dict
        ``log``, ``channels``, ``start``, ``stop`` and ``bins``.

    Returns
    -------
    bytes

    Raises
    ------
    RequestError
        When it was not read.
    """
    info = session.log(needed(asked, "log"))["info"]
    if not info or not info["curves"]:
        raise RequestError("this log was not read")
    curves = Curves(session.folder / info["curves"])
    return packed(curves.view(needed(asked, "channels").split(",")[:20], *_stretch(asked)))


def _residual(curves: Curves, record: Mapping[str, Any], asked: Asked) -> tuple[str, list[str], list[str]]:
    names = [one["name"] for one in record["balances"]]
    balance = asked.get("balance", "torque")
    if balance not in names:
        balance = names[0]
    parts = next(one["parts"] for one in record["balances"] if one["name"] == balance)
    off = [name for name in asked.get("off", "").split("|") if name in parts]
    return balance, parts, off


def of_model(session: Session, asked: Asked) -> bytes:
    """Return both sides of a balance, the residual and the speed over a stretch of time.

    Parameters
    ----------
    session : Session
    asked : dict
        ``record``, ``balance``, ``off`` (effects that are switched off, separated by bars), ``start``, ``stop``,
        ``bins``.

    Returns
    -------
    bytes
    """
    record = _record(session, asked)
    curves = Curves(session.folder / record["curves"])
    balance, _, off = _residual(curves, record, asked)
    start, stop, bins = _stretch(asked)
    stored = {
        "measured": f"{balance}:measured", "predicted": f"{balance}:predicted", "residual": f"{balance}:residual",
        "speed": f"over:{record['coordinates'][0]}",
    }  # fmt: skip
    if not off and stored["residual"] in curves.names:  # a session of an earlier version has not stored it
        found = curves.view(list(stored.values()), start, stop, bins)
        return packed({"t": found["t"]} | {name: found[column] for name, column in stored.items()})
    part = curves.within(start, stop)
    measured, predicted, speed = (np.asarray(curves[stored[k]][part]) for k in ("measured", "predicted", "speed"))
    for name in off:
        predicted = predicted - curves[f"{balance}:part:{name}"][part]
    columns = {"measured": measured, "predicted": predicted, "residual": measured - predicted, "speed": speed}
    return packed(_thinned(np.asarray(curves.t[part]), columns, bins))


def _thinned(t: Array, columns: Mapping[str, Any], bins: int) -> dict[str, Array]:
    """Return all samples, or the smallest and the largest of every bin."""
    count = len(t)
    bins = max(2, min(bins, DOTS))
    if count <= 2 * bins:
        return {"t": t} | {name: np.asarray(values, dtype=np.float64) for name, values in columns.items()}
    step = -(-count // bins)
    places = np.arange(0, count, step)
    out = {"t": np.column_stack([t[places], t[np.minimum(places + step // 2, count - 1)]]).ravel()}
    for name, values in columns.items():
        low, high = np.minimum.reduceat(values, places), np.maximum.reduceat(values, places)
        out[name] = np.column_stack([low, high]).ravel().astype(np.float64)
    return out


def of_scatter(session: Session, asked: Asked) -> bytes:
    """Return the residual over a coordinate: some dots, and the mean of every band.

    Parameters
    ----------
    session : Session
    asked : dict
        As for `of_model`, and ``over``, the label of a coordinate.

    Returns
    -------
    bytes
    """
    record = _record(session, asked)
    curves = Curves(session.folder / record["curves"])
    balance, _, off = _residual(curves, record, asked)
    start, stop, _ = _stretch(asked)
    part = _spread_over(curves.within(start, stop))
    used = curves["used"][part] > 0.5
    over = asked.get("over", record["coordinates"][0])
    x = np.asarray(curves[f"over:{over}"][part], dtype=np.float64)[used]
    y = np.asarray(curves[f"{balance}:measured"][part] - curves[f"{balance}:predicted"][part], dtype=np.float64)
    for name in off:
        y = y + curves[f"{balance}:part:{name}"][part]
    y = y[used]
    step = max(1, len(x) // DOTS)
    centres, means = _means(x, y)
    return packed({"x": x[::step], "y": y[::step], "centre": centres, "mean": means})


def _spread_over(part: slice) -> slice | NDArray[np.intp]:
    """Return a stretch, or where it is long one sample of every block of it.

    The place in the block changes from one to the next: at a fixed one a motion that repeats would show some of its
    positions only.
    """
    count = part.stop - part.start
    if count <= MOST_MEANT:
        return part
    blocks = np.arange(MOST_MEANT)
    places = (blocks + np.mod(GOLDEN * blocks, 1.0)) * (count / MOST_MEANT)
    chosen: NDArray[np.intp] = part.start + places.astype(np.intp)
    return chosen


def _means(x: Array, y: Array) -> tuple[Array, Array]:
    """Return the mean of every band of a coordinate that has samples enough."""
    if len(x) < FEWEST:
        return np.zeros(0), np.zeros(0)
    low, high = float(x.min()), float(x.max())
    band = np.minimum(((x - low) / max(high - low, 1e-300) * BANDS).astype(int), BANDS - 1)
    counts = np.bincount(band, minlength=BANDS)
    kept = counts >= FEWEST
    means = np.bincount(band, y, BANDS)[kept] / counts[kept]
    return (low + (np.arange(BANDS) + 0.5) * (high - low) / BANDS)[kept], means


def of_preview(session: Session, asked: Asked) -> bytes:
    """Return the curve of a candidate over a stretch of time.

    Parameters
    ----------
    session : Session
    asked : dict
        ``curves``, made by the server, and the stretch.

    Returns
    -------
    bytes
    """
    curves = Curves(session.folder / asked["curves"])
    start, stop, bins = _stretch(asked)
    part = curves.within(start, stop)
    return packed(_thinned(np.asarray(curves.t[part]), {"preview": np.asarray(curves["preview"][part])}, bins))


VIEWS: dict[str, Callable[[Session, Asked], bytes]] = {
    "log": of_log, "model": of_model, "scatter": of_scatter, "preview": of_preview,
}  # fmt: skip
