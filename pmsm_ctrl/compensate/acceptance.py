"""Acceptance: a design's ``[[acceptance]]`` lines, each a trial, a metric and a limit, run as the drive would."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from pmsm_ctrl.compensate.metrics import CHANGE, UNITS
from pmsm_ctrl.compensate.motions import named_trial
from pmsm_ctrl.compensate.runs import judge, run_trial
from pmsm_ctrl.compensate.variants import compensated
from pmsm_ctrl.design import Acceptance, Design
from pmsm_ctrl.errors import DesignError, RequestError, nearest
from pmsm_ctrl.log import Log

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["METRICS", "Verdict", "accept"]

# Metrics by name with their units; NAME_change is the change against no compensation, -0.8 being -80 %.
METRICS = UNITS | {f"{name}_change": "1" for name in CHANGE}


@dataclass(frozen=True, eq=False)
class Verdict:
    """What became of one line of the acceptance.

    Attributes
    ----------
    wanted : Acceptance
    value : float
        The metric, in `unit`.
    found, reference : float
        What a change is made of: the metric with the compensation and with its gain at 0.
    with_it, without : tuple of Log
        Logs of the axes with the compensation and with its gain at 0.
    """

    design: Design
    wanted: Acceptance
    value: float
    unit: str
    found: float
    reference: float
    with_it: tuple[Log, ...]
    without: tuple[Log, ...]

    @property
    def passed(self) -> bool:
        """Whether the metric is within its limit; a number that is not finite is not."""
        return self.value <= self.wanted.limit

    def summary(self) -> str:
        """Return scenario, metric, value and limit in one line."""
        w = self.wanted
        if w.metric.endswith("_change"):
            unit = UNITS[w.metric.removesuffix("_change")]
            said = f"{w.metric} = {100 * self.value:+.1f} %, limit {100 * w.limit:+.1f} %"
            said += f" ({self.found:.4g} {unit}; without compensation {self.reference:.4g} {unit})"
        else:
            unit = "" if self.unit == "1" else f" {self.unit}"
            said = f"{w.metric} = {self.value:.4g}{unit}, limit {w.limit:.4g}{unit}"
        off = "" if w.factor == 1.0 else f", compensated parameters {100 * (w.factor - 1.0):+.0f} %"
        return f"{'passed' if self.passed else 'FAILED'}: {w.scenario}{off}: {said}"

    def plot(self) -> Figure:
        """Draw the position error with and without the compensation, and the current that it takes."""
        from matplotlib.figure import Figure

        angle = "m" if self.design.motion == "linear" else "rad"
        figure = Figure(figsize=(8.0, 5.0), layout="constrained")
        head, _, rest = self.summary().partition(" (")
        title = f"{self.design.name}, {head}"
        figure.suptitle(f"{title}\n{rest.removesuffix(')')}" if rest else title, fontsize="medium")
        upper, lower = figure.subplots(2, 1, sharex=True)
        runs = (("without compensation", self.without, "#0072B2"), ("as designed", self.with_it, "#D55E00"))
        for label, logs, colour in runs:
            for axis, log in enumerate(logs):
                style = ("-", "--")[axis]
                name = label if len(logs) == 1 else f"{label}, axis {axis + 1}"
                error = log["theta_ref"] - log["theta_true"]
                upper.plot(log.t, 1e3 * error, style, color=colour, linewidth=0.8, label=name)
                lower.plot(log.t, log["i_q_ref"], style, color=colour, linewidth=0.6)
        upper.set_ylabel(f"position error [m{angle}]")
        upper.legend(fontsize="small", ncols=2, loc="lower right")
        lower.set_ylabel("current reference [A]")
        lower.set_xlabel("time [s]")
        for axes in (upper, lower):
            axes.grid(alpha=0.3)
        return figure


def accept(design: Design, wanted: Acceptance, *, seed: int = 0) -> Verdict:
    """Run one line of a design's acceptance.

    The drive runs as the design says, its compensation included; the plant is the design. With a factor the
    compensated parameters are off by it, the plant's are not.

    Raises
    ------
    RequestError
        When the scenario or the metric does not exist.
    DesignError
        When the design cannot be simulated, or a change is asked of a design without compensation.
    """
    if wanted.metric not in METRICS:
        raise RequestError(
            f"unknown metric '{wanted.metric}'{nearest(wanted.metric, METRICS)} (known: {', '.join(METRICS)})"
        )
    trial = named_trial(design, wanted.scenario)
    chosen = design.compensation
    if wanted.metric.endswith("_change") and chosen.gain == 0.0:
        raise DesignError(
            f"{design.source or design.name}: compensation.gain: found 0; '{wanted.metric}' compares with no "
            "compensation and needs a gain above 0"
        )
    off = design.model_copy(update={"compensation": chosen.model_copy(update={"gain": 0.0})})
    believed = design
    if wanted.factor != 1.0:
        believed = compensated(
            design, chosen.effects, gain=chosen.gain, source=chosen.source, factor=wanted.factor,
            smoothing=chosen.smoothing,
        )  # fmt: skip
    with_it = run_trial(believed, trial, truth=design, seed=seed)
    without = with_it if chosen.gain == 0.0 else run_trial(off, trial, truth=design, seed=seed)
    name = wanted.metric.removesuffix("_change")
    found, reference = (float(getattr(judge(trial, logs), name)) for logs in (with_it, without))
    value = found
    if name != wanted.metric:
        value = found / reference - 1.0 if reference > 0.0 else 0.0
    return Verdict(design, wanted, value, METRICS[wanted.metric], found, reference, with_it, without)
