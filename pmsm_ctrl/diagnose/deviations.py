"""Wrong parameters: estimated inside their tolerance, and flagged where a log puts them significantly outside."""

from __future__ import annotations

from typing import Any

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.gates import RELIEF, WINDING, name_of, relief, strain
from pmsm_ctrl.diagnose.selection import Selection
from pmsm_ctrl.units import axis_unit

__all__ = ["parameter_deviations", "stood_in"]

UNITS = {"J": "kg m^2", "R": "Ohm", "L_d": "H", "L_q": "H", "psi_f": "Wb", "K_t": "N m/A"}
# The torque constant scales every torque that is identified with it: less is forgiven than on a datasheet.
TORQUE_CONSTANT = 0.02


def parameter_deviations(design: Design, fit: Fitted) -> tuple[tuple[Any, ...], tuple[str, ...]]:
    """Return the deviations, torque constant first, and hints in words."""
    from pmsm_ctrl.diagnose.diagnosis import Deviation

    values = dict(zip(fit.model.names, fit.plain.values, strict=True))
    stderr = dict(zip(fit.model.names, fit.plain.stderr, strict=True))
    motion = fit.record.prepared.motion
    out, hints = [], []
    if "psi_f" in values and design.motor.p is not None:
        factor = 1.5 * design.motor.p
        estimate, error = factor * values["psi_f"], factor * stderr["psi_f"]
        nominal = design.K_t_assumed
        off = estimate / nominal - 1.0
        flagged = abs(off) > TORQUE_CONSTANT and abs(estimate - nominal) > 4.0 * error
        note = ""
        if flagged:
            note = (
                f"the torque constant of the evaluation, {nominal:.4g} N m/A, is {100 * -off / (1 + off):+.1f} % off "
                f"what the voltages say ({estimate:.4g}): J, F_c, F_v and every other torque are off alike"
            )
            hints.append(note)
        out.append(Deviation("K_t", nominal, estimate, error, UNITS["K_t"], flagged, note))
    for name in ("J", "psi_f", "R", "L_d", "L_q"):
        if name not in values:
            continue
        nominal = design.J if name == "J" else float(getattr(design.motor, name))
        tolerance = design.motor.tolerance.get(name, 0.15)
        beyond = abs(values[name] / nominal - 1.0) * nominal - tolerance * nominal
        flagged = beyond > 3.0 * stderr[name]
        note = f"beyond its tolerance of {100 * tolerance:.0f} %" if flagged else ""
        if flagged and name in WINDING:
            note += _healers(fit)
        unit = axis_unit(UNITS[name], motion)
        out.append(Deviation(name, nominal, float(values[name]), float(stderr[name]), unit, bool(flagged), note))
    for k, name in enumerate(fit.model.names):
        group = fit.model.group_of(k)
        if group.effect is None or group.entry < 0 or fit.model.nominal[k] == 0.0:
            continue
        symbol = name.split("#")[0]
        p = group.effect.parameter(symbol)
        value, error, nominal = fit.plain.values[k], fit.plain.stderr[k], fit.model.nominal[k]
        if np.isfinite(error):
            out.append(Deviation(name, float(nominal), float(value), float(error), axis_unit(p.unit, motion), False))
    if fit.record.age is not None:
        age, error = fit.record.age + values["tau_speed"], stderr["tau_speed"]
        if abs(age) > max(4.0 * error, 0.1 * fit.record.period):
            hints.append(
                f"the logged speed is {1e3 * age:.2g} +- {1e3 * error:.1g} ms older than the torque, which was undone: "
                "a filter of the drive, or a delay between channels; a log with theta tells which"
            )
    return tuple(out), tuple(hints)


def _healers(fit: Fitted) -> str:
    """Name the effects that would bring the winding back to its datasheet."""
    ids = [
        trial.candidate.effect.id
        for trial in fit.trials
        if not (trial.wrong_sign or trial.singular) and relief(fit.plain, trial.plain_direction) > RELIEF
    ]
    return f"; {' or '.join(ids)} would bring it back" if ids else ""


def stood_in(selection: Selection) -> tuple[str, ...]:
    """Say which parameter of the winding had stood in for an effect, that a reader can choose."""
    hints = []
    for step, before, after in zip(selection.steps, selection.fits[:-1], selection.fits[1:], strict=True):
        if strain(before.plain) - strain(after.plain) <= RELIEF:
            continue
        model = before.model
        strained = {
            name: abs(value - nominal) / sigma
            for name, value, nominal, sigma in zip(
                model.names, before.plain.values, model.nominal, model.sigma, strict=True
            )
            if name in WINDING
        }
        name = max(strained, key=lambda n: strained[n])
        k = model.names.index(name)
        value, nominal = float(before.plain.values[k]), float(model.nominal[k])
        hints.append(
            f"{name_of(step.trial)}: without it {name} would be {value:.3g} {UNITS[name]}, {value / nominal:.2g} times "
            "its nominal value, and explain nearly as much"
        )
    return tuple(hints)
