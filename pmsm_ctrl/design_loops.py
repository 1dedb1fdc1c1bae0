"""The controllers of a design: the cascade of current, speed and position loop, and the filters in it."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import Field, model_validator

from pmsm_ctrl.biquads import Biquad, lead, low_pass, notch
from pmsm_ctrl.design_parts import NonNegative, Part, Positive

__all__ = ["CurrentLoop", "Filter", "Loops", "PositionLoop", "SpeedLoop"]


class CurrentLoop(Part):
    """PI current controller: u = K_p (e + 1/T_n integral of e), the same in both axes or per axis."""

    K_p: Positive = Field(description="proportional gain, V/A")
    T_n: Positive = Field(description="reset time, s")
    K_p_d: Positive | None = Field(default=None, description="d-axis gain where it differs, V/A")
    T_n_d: Positive | None = Field(default=None, description="d-axis reset time where it differs, s")


class Filter(Part):
    """A filter of the current reference, sampled at the rate of the speed loop (Tustin, prewarped at `frequency`)."""

    kind: Literal["notch", "low_pass", "lead"] = Field(description="notch, low_pass or lead")
    frequency: Positive = Field(
        description="of the notch, corner of the low-pass (order 2: natural frequency), largest lead, Hz"
    )
    width: Positive | None = Field(default=None, description="notch: between its 3 dB points when complete, Hz")
    depth: Positive | None = Field(
        default=None, le=200.0, description="notch: attenuation at its frequency, dB; left out: complete"
    )
    order: Literal[1, 2] | None = Field(default=None, description="low_pass: 1 or 2, the default")
    damping: float | None = Field(
        default=None, ge=0.05, le=10.0, description="low_pass of order 2; left out: sqrt(1/2), Butterworth's"
    )
    phase: float | None = Field(default=None, gt=0.0, le=70.0, description="lead: at its frequency, deg")

    @model_validator(mode="after")
    def _of_its_kind(self) -> Filter:
        own = {"notch": ("width", "depth"), "low_pass": ("order", "damping"), "lead": ("phase",)}[self.kind]
        for field in ("width", "depth", "order", "damping", "phase"):
            if getattr(self, field) is not None and field not in own:
                raise ValueError(f"{field} does not belong to a filter of kind {self.kind} ({', '.join(own)} do)")
        needed = {"notch": "width", "lead": "phase"}.get(self.kind)
        if needed is not None and getattr(self, needed) is None:
            raise ValueError(f"{needed} is missing; a filter of kind {self.kind} needs it")
        if self.damping is not None and self.order == 1:
            raise ValueError("damping belongs to a low_pass of order 2")
        return self

    @property
    def biquad(self) -> Biquad:
        """The filter's transfer function."""
        if self.kind == "notch":
            assert self.width is not None  # guaranteed by _of_its_kind
            return notch(self.frequency, self.width, math.inf if self.depth is None else self.depth)
        if self.kind == "low_pass":
            return low_pass(self.frequency, self.order or 2, math.sqrt(0.5) if self.damping is None else self.damping)
        assert self.phase is not None  # guaranteed by _of_its_kind
        return lead(self.frequency, self.phase)


class SpeedLoop(Part):
    """PI speed controller with reference filter, i_q = K_p (e + 1/T_n integral of e), and filters of what it asks for.

    All that is asked for passes through the filters, feedforward included; then the current is limited.
    """

    K_p: NonNegative = Field(description="proportional gain, A/(rad/s)")
    T_n: Positive = Field(description="reset time, s")
    reference_filter: NonNegative = Field(default=0.0, description="time constant of the reference filter, s")
    filters: tuple[Filter, ...] = Field(default=(), max_length=8, description="of the current reference, in order")


class PositionLoop(Part):
    """Proportional position controller with feedforward: omega = K_v e + k_v omega_ref; i_q += k_a J alpha_ref/K_t."""

    K_v: NonNegative = Field(description="position gain, 1/s")
    velocity_feedforward: NonNegative = Field(default=1.0, description="share of the reference speed fed forward")
    acceleration_feedforward: NonNegative = Field(default=0.0, description="share of J alpha_ref fed forward")
    velocity_filter: NonNegative | None = Field(
        default=None,
        description="time constant of the filter of the reference speed in position control, s; the speed loop's "
        "reference filter where left out",
    )


class Loops(Part):
    """The cascade."""

    current: CurrentLoop
    speed: SpeedLoop
    position: PositionLoop = PositionLoop(K_v=0.0)

    def require_sampled(self, period: float) -> None:
        """Refuse a filter of the current reference that its sampling cannot represent.

        Parameters
        ----------
        period : float
            Of the speed controller, s.

        Raises
        ------
        ValueError
            For the first filter at half the rate of the speed loop or above.
        """
        limit = 0.5 / period
        for number, one in enumerate(self.speed.filters):
            if one.frequency >= 0.999 * limit:
                raise ValueError(
                    f"loops.speed.filters.{number}.frequency: found {one.frequency:g} Hz; below {limit:g} Hz, half the "
                    "rate of the speed loop (drive.f_control / drive.speed_divider), was expected"
                )

    def reference_filter(self, *, in_position: bool) -> float:
        """Return the time constant of the reference speed's filter in speed control, or in position control, s.

        Parameters
        ----------
        in_position : bool
        """
        own = self.position.velocity_filter
        return own if in_position and own is not None else self.speed.reference_filter
