"""filterpy's two filters with this model: the estimators of record, which a reader can follow line by line."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.track import model

if TYPE_CHECKING:
    from pmsm_ctrl.track.live import FrictionTracker

__all__ = ["Extended", "Unscented"]

Array = NDArray[np.float64]
Split = tuple[float, float] | None


class Extended:
    """filterpy.kalman.ExtendedKalmanFilter; its update is Joseph's form."""

    def __init__(self, x: Array, P: Array, axis: FrictionTracker) -> None:
        from filterpy.kalman import ExtendedKalmanFilter

        self.axis = axis
        self.kf = ExtendedKalmanFilter(dim_x=x.size, dim_z=1)
        self.kf.x, self.kf.P = x.copy(), P.copy()

    def predict(self, direction: float) -> None:
        """Carry mean and covariance one step on."""
        axis, kf = self.axis, self.kf
        J = axis.full(kf.x)[model.INERTIA]
        moved, rates = axis.moved(kf.x, direction)
        dt = float(axis._m[model.DT])
        F = np.eye(model.SIZE)
        F[model.OMEGA, :5] += dt * np.array(rates[1:])
        F[model.THETA, :5] += 0.5 * dt * F[model.OMEGA, :5]
        F[model.THETA, model.OMEGA] += 0.5 * dt
        kf.F = F[np.ix_(axis._index, axis._index)]
        kf.Q = axis.process_noise(J)
        kf.predict_x = lambda u=0: setattr(kf, "x", moved[axis._index])
        kf.predict()
        kf.P = 0.5 * (kf.P + kf.P.T)

    def innovation(self, z: float, direction: float) -> tuple[float, float]:
        """Return measured less predicted, and its variance."""
        predicted, row = self.axis.seen(self.kf.x, direction)
        h = row[self.axis._index]
        return z - predicted, float(h @ self.kf.P @ h + self.axis._s[model.R])

    def update(self, z: float, direction: float, split: Split) -> None:
        """Take the measurement in; `split` holds the ratio of F_c and F_v."""
        axis, kf = self.axis, self.kf
        h = axis.seen(kf.x, direction)[1][axis._index].reshape(1, -1)
        kf.R = np.array([[axis._s[model.R]]])
        x, P = kf.x.copy(), kf.P.copy()
        kf.update(
            np.array([z]),
            HJacobian=lambda _: h,
            Hx=lambda state: np.array([axis.seen(state, direction)[0]]),
        )
        if split is not None:
            K = _held(kf.K, x, split)
            kf.x = x + K @ np.atleast_1d(kf.y)
            rest = np.eye(x.size) - K @ h
            kf.P = rest @ P @ rest.T + axis._s[model.R] * K @ K.T
        kf.P = 0.5 * (kf.P + kf.P.T)


class Unscented:
    """filterpy.kalman.UnscentedKalmanFilter with Van der Merwe's sigma points."""

    def __init__(self, x: Array, P: Array, axis: FrictionTracker) -> None:
        from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

        self.axis = axis
        self.direction = 1.0
        points = MerweScaledSigmaPoints(x.size, alpha=0.5, beta=2.0, kappa=3.0 - x.size)
        self.kf = UnscentedKalmanFilter(
            dim_x=x.size, dim_z=1, dt=1.0, hx=self._seen, fx=self._moved, points=points
        )  # fmt: skip
        self.kf.x, self.kf.P = x.copy(), P.copy()

    def _moved(self, x: Array, dt: float) -> Array:
        return self.axis.moved(x, self.direction)[0][self.axis._index]

    def _seen(self, x: Array) -> Array:
        return np.array([self.axis.seen(x, self.direction)[0]])

    def predict(self, direction: float) -> None:
        """Carry the sigma points one step on."""
        self.direction = direction
        self.kf.Q = self.axis.process_noise(self.axis.full(self.kf.x)[model.INERTIA])
        self.kf.predict()
        self.kf.P = 0.5 * (self.kf.P + self.kf.P.T)

    def innovation(self, z: float, direction: float) -> tuple[float, float]:
        """Return measured less predicted, and its variance, by the sigma points."""
        self.direction = direction
        kf = self.kf
        kf.sigmas_f = kf.points_fn.sigma_points(kf.x, kf.P)
        seen = np.array([self._seen(point)[0] for point in kf.sigmas_f])
        mean = float(kf.Wm @ seen)
        return z - mean, float(kf.Wc @ (seen - mean) ** 2 + self.axis._s[model.R])

    def update(self, z: float, direction: float, split: Split) -> None:
        """Take the measurement in; `split` holds the ratio of F_c and F_v."""
        axis, kf = self.axis, self.kf
        self.direction = direction
        kf.R = np.array([[axis._s[model.R]]])
        kf.sigmas_f = kf.points_fn.sigma_points(kf.x, kf.P)  # the covariance may have been raised since
        x, P = kf.x.copy(), kf.P.copy()
        kf.update(np.array([z]))
        if split is not None:
            cross = kf.K @ kf.S
            K = _held(kf.K, x, split)
            kf.x = x + K @ np.atleast_1d(kf.y)
            kf.P = P - K @ cross.T - cross @ K.T + K @ kf.S @ K.T
        kf.P = 0.5 * (kf.P + kf.P.T)


def _held(K: Any, x: Array, split: tuple[float, float]) -> Array:
    """Return the gain turned so that F_c and F_v keep their ratio."""
    held = np.array(K, dtype=np.float64)
    held[1, 0], held[2, 0] = model.keep_split(held[1, 0], held[2, 0], x[1], x[2], *split)
    return held
