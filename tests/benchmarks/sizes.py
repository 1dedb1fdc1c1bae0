"""The same drive in other sizes: other units of torque, current and time, exactly.

Newton's and Maxwell's laws have no units of their own: with torques times `torque`, currents times `current` and times
times `time` the log is that of another motor, of another drive, and sampled at another rate. Angles stay as they are.
What a diagnosis takes for granted of sizes, rates and time constants shows when it answers otherwise.
"""

from __future__ import annotations

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log

__all__ = ["SIZES", "sized"]

# Factors of torque, current and time: log rates of 170 to 670 Hz and of 1.7 to 6.7 kHz in place of 500 to 2000 Hz.
SIZES: dict[str, tuple[float, float, float]] = {
    "large": (200.0, 20.0, 1.0), "small": (0.02, 0.05, 1.0), "slow": (1.0, 1.0, 3.0), "fast": (1.0, 1.0, 0.3),
}  # fmt: skip


def sized(design: Design, log: Log, torque: float, current: float, time: float) -> tuple[Design, Log]:
    """Return a design without loops and its log in another size; friction is Coulomb's and viscous."""
    voltage = torque / (time * current)
    channels = {
        "t": time, "omega": 1.0 / time, "omega_ref": 1.0 / time, "i_d": current, "i_q": current,
        "u_d": voltage, "u_q": voltage,
    }  # fmt: skip
    motor = {
        "R": voltage / current, "L_d": voltage * time / current, "L_q": voltage * time / current,
        "psi_f": voltage * time, "J": torque * time**2,
    }  # fmt: skip
    friction = {"F_c": torque, "F_v": torque * time}
    words = design.to_dict()
    words["motor"] |= {name: words["motor"][name] * factor for name, factor in motor.items()}
    words["drive"] |= {"f_control": words["drive"]["f_control"] / time, "i_max": words["drive"]["i_max"] * current}
    words["effects"] = [
        {name: value * friction[name] if name in friction else value for name, value in entry.items()}
        for entry in words["effects"]
    ]
    return Design.from_dict(words), Log({n: values * channels.get(n, 1.0) for n, values in log.channels.items()})
