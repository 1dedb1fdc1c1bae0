"""A load that bounces between flanks, followed by a Kalman filter that every sample of the shaft's angle corrects.

Along a measured motion alone a small error of the motion grows with every bounce: the load's course is lost after a few
of them. Each impact moves the shaft, so the measured angle says where the load is.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.effects.evaluate import called, compiled_loop

if TYPE_CHECKING:
    from pmsm_ctrl.effects.base import Effect

__all__ = ["course", "innovations"]

Array = NDArray[np.float64]


def innovations(
    effect: Effect, values: Mapping[str, float], inertias: tuple[float, float], theta: Array, torque: Array,
    period: float, noise: tuple[float, float, float, float], steps: int,
) -> tuple[Array, Array]:  # fmt: skip
    """Return what each sample of the angle differs by from what was expected of it, and the variance of that.

    Parameters
    ----------
    effect : Effect
        A contact law of the twist and its rate.
    values : dict of str to float
        Its parameters.
    inertias : (float, float)
        Of the shaft and of the load, kg m^2 (kg).
    theta : array, shape (n,)
        Angle of the shaft, rad (m).
    torque : array, shape (n,)
        What accelerates both, N m (N); a straight line between samples.
    period : float
        Of the samples, s.
    noise : (float, float, float, float)
        Standard deviations: of the torque over a sample, of the angle, of the load's speed, gained in a sample, and of
        the load's position at first.
    steps : int
        Of the integration in a sample.

    Returns
    -------
    (array, array), each of shape (n,)
    """
    out = np.empty((2, len(theta)))
    _run(effect, values, inertias, theta, torque, period, noise, 1.0, steps, out)
    return out[0], out[1]


def course(
    effect: Effect, values: Mapping[str, float], inertias: tuple[float, float], theta: Array, torque: Array,
    period: float, steps: int,
) -> Array:  # fmt: skip
    """Return the angle of the shaft, shape (n,), that a torque makes from the first two samples of an angle on.

    Parameters
    ----------
    effect, values, inertias, theta, torque, period, steps
        As for `innovations`.
    """
    out = np.empty((2, len(theta)))
    _run(effect, values, inertias, theta, torque, period, (0.0, np.inf, 0.0, 0.0), 0.0, steps, out)
    return np.asarray(theta - out[0], dtype=np.float64)


def _run(
    effect: Effect, values: Mapping[str, float], inertias: tuple[float, float], theta: Array, torque: Array,
    period: float, noise: tuple[float, ...], kept: float, steps: int, out: Array,
) -> None:  # fmt: skip
    loop, symbols = compiled_loop(effect, "contact filter", _loop)
    loop(
        out,
        theta,
        torque,
        period,
        steps,
        *inertias,
        np.array(noise),
        kept,
        *(float(values[symbol]) for symbol in symbols),
    )


def _loop(effect: Effect) -> tuple[str, tuple[str, ...]]:
    """Source of the filter around the effect's contact law, and the parameters it takes."""
    symbols = tuple(p.symbol for p in effect.parameters if p.symbol in effect.arguments)
    own = {symbol: f"_p_{symbol}" for symbol in symbols}
    call = called(effect, twist="_points[0, _m] - _points[2, _m]", twist_rate="_points[1, _m] - _points[3, _m]", **own)
    return (
        "import numpy as np\n\n"
        "from pmsm_ctrl.kernels.sigma_points import POINTS, corrected, gathered\n\n\n"
        "def loop(_out, _theta, _torque, _period, _steps, _shaft, _load, _noise, _kept, "
        f"{', '.join(own.values())}):\n"
        "    _h = _period / _steps\n"
        "    _x, _P, _work, _points = np.zeros(4), np.zeros((4, 4)), np.zeros((4, 4)), np.zeros((5, POINTS))\n"
        "    _x[0] = _x[2] = _theta[0]\n"
        "    _x[1] = _x[3] = (_theta[1] - _theta[0]) / _period\n"
        "    _square = _noise[1] * _noise[1]\n"
        "    if _kept > 0.0:\n"
        "        _P[0, 0] = _square\n"
        "        _P[1, 1] = _P[3, 3] = 2.0 * _square / (_period * _period)\n"
        "        _P[2, 2] = _noise[3] * _noise[3] + _square\n"
        "    for _n in range(_theta.size):\n"
        "        _out[0, _n] = _theta[_n] - _x[0]\n"
        "        _out[1, _n] = corrected(_x, _P, _theta[_n], _square, _noise[0], _work, _points)\n"
        "        if _n + 1 == _theta.size:\n"
        "            break\n"
        "        for _s in range(_steps):\n"
        "            _part = (_s + 0.5) / _steps\n"
        "            _drive = (1.0 - _part) * _torque[_n] + _part * _torque[_n + 1]\n"
        "            for _m in range(POINTS):\n"
        f"                _contact = {call}\n"
        "                _rate = _points[1, _m] + _h * (_drive + _points[4, _m] - _contact) / _shaft\n"
        "                _speed = _points[3, _m] + _h * _contact / _load\n"
        "                _points[0, _m] += _h * _rate\n"
        "                _points[1, _m] = _rate\n"
        "                _points[2, _m] += _h * _speed\n"
        "                _points[3, _m] = _speed\n"
        "        gathered(_points, _noise[2] * _noise[2], _kept, _x, _P)\n"
    ), symbols
