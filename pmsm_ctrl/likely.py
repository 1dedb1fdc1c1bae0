"""Numbers of a design that are unlikely for a servo motor: a unit, a convention or a decimal point was misread."""

from __future__ import annotations

import math

from pmsm_ctrl.design import Design
from pmsm_ctrl.section import Notice, Template
from pmsm_ctrl.units import RPM

__all__ = ["FACTS", "LIKELY", "UNLIKELY", "figures_of", "unlikely"]

UNLIKELY = Template("unlikely_value", "{name} of {value} is unlikely for a servo motor: check the units")
# Outside these ranges a number was probably misread.
LIKELY = {
    "electrical time constant L/R": (0.05e-3, 0.2),
    "no-load speed": (50 * RPM, 2e5 * RPM),
    "no-load speed, linear": (0.02, 100.0),  # m/s
    "torque at the current limit over J": (30.0, 2e7),
    "force at the current limit over the mass": (0.1, 2e3),
    "dc-link voltage": (5.0, 2000.0),  # V: drives of 6 V, and of mains of 690 V
    "pole pitch": (1e-3, 0.3),  # m: linear motors have 5 to 60 mm
    "encoder resolution": (16.0, math.inf),  # counts a turn: fewer than the Hall signals of three pole pairs
    "encoder resolution, linear": (1e3, math.inf),  # counts a metre: a step above 1 mm
}
# What `init` prints to be checked; the others are looked at alone.
FACTS = (
    "electrical time constant L/R", "no-load speed", "no-load speed, linear", "torque at the current limit over J",
    "force at the current limit over the mass",
)  # fmt: skip


def figures_of(design: Design) -> dict[str, tuple[float, str]]:
    """Return what follows from the numbers of a design, by name: the value, and how it is shown.

    The no-load speed is where the EMF ``p psi_f omega`` meets the largest phase voltage, ``u_dc / sqrt(3)``.

    Parameters
    ----------
    design : Design
    """
    motor, drive, linear = design.motor, design.drive, design.motion == "linear"
    out: dict[str, tuple[float, str]] = {}
    if motor.p is not None and motor.psi_f is not None and motor.R is not None and motor.L_q is not None:
        speed = drive.u_dc / math.sqrt(3.0) / (motor.p * motor.psi_f)
        shown = f"{speed:.4g} m/s" if linear else f"{speed / RPM:.4g} rpm"
        out["electrical time constant L/R"] = motor.L_q / motor.R, f"{1e3 * motor.L_q / motor.R:.3g} ms"
        out["no-load speed" + linear * ", linear"] = speed, f"{shown} at {drive.u_dc:.4g} V dc"
        out["dc-link voltage"] = drive.u_dc, f"{drive.u_dc:.4g} V"
        if linear:
            out["pole pitch"] = math.pi / motor.p, f"{1e3 * math.pi / motor.p:.3g} mm (pi / p)"
    if math.isfinite(drive.i_max) and motor.J is not None:
        torque = design.K_t * drive.i_max
        name = "force at the current limit over the mass" if linear else "torque at the current limit over J"
        shown = f"{torque:.3g} {'N' if linear else 'N m'}, {torque / design.J:.3g} {'m' if linear else 'rad'}/s^2"
        out[name] = torque / design.J, shown
    if counts := design.sensor.encoder_counts:
        per = "metre" if linear else "turn"
        out["encoder resolution" + linear * ", linear"] = float(counts), f"{counts} counts per {per}"
    return out


def unlikely(design: Design) -> list[Notice]:
    """Return the numbers of a design that are unlikely.

    Parameters
    ----------
    design : Design

    Returns
    -------
    list of Notice
    """
    return [
        UNLIKELY(name=name.removesuffix(", linear"), value=shown)
        for name, (value, shown) in figures_of(design).items()
        if not LIKELY[name][0] <= value <= LIKELY[name][1]
    ]
