"""The questions about a datasheet, for every kind of machine, with the units that are accepted."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from pmsm_ctrl.units import KRPM

__all__ = ["MACHINES", "PITCH", "QUESTIONS", "Answer", "Question", "option_of"]


def option_of(key: str) -> str:
    """Return the command's option of a question.

    Parameters
    ----------
    key : str
    """
    return "--" + key.replace("_", "-")


@dataclass(frozen=True)
class Answer:
    """One number of the sheet under its name in a design.

    Attributes
    ----------
    field : str
    value : float
    unit : str
        As accepted by the question; empty for a plain number.
    stated : bool
        False for the default of a question that nobody answered.
    """

    field: str
    value: float
    unit: str
    stated: bool = True


@dataclass(frozen=True)
class Question:
    """One value of a datasheet.

    Attributes
    ----------
    key : str
        Its name; the option of the command is the key with hyphens.
    text : str
        What is asked.
    table : str
        Table of the design that it belongs to; empty for the check that is not written.
    units : mapping of unit to (field, factor)
        What is accepted; empty for a plain number, whose field is the key.
    default : str or None
        What is taken without an answer; None: it must be answered, "": it is left out.
    beside : str
        Key of a question without whose answer this one is not asked; empty for one that always is.
    """

    key: str
    text: str
    table: str
    units: Mapping[str, tuple[str, float]]
    default: str | None = None
    beside: str = ""

    @property
    def option(self) -> str:
        """The command's option."""
        return option_of(self.key)

    @property
    def accepted(self) -> str:
        """The units in words."""
        return ", ".join(self.units) or "a number"


_EMF = {
    f"V {amplitude} {where}/{speed}": (f"K_e_{where}_{amplitude}_per_{name}", 1.0)
    for speed, name in (("krpm", "krpm"), ("(rad/s)", "rad_s"))
    for where in ("line", "phase")
    for amplitude in ("rms", "peak")
}

QUESTIONS: tuple[Question, ...] = (
    Question("pole_pairs", "pole pairs (half the number of poles)", "motor", {}),
    Question("torque_constant", "torque constant", "motor", {
        "N m/A rms": ("K_t_rms", 1.0), "N m/A peak": ("K_t_peak", 1.0), "mN m/A rms": ("K_t_rms", 1e-3),
        "mN m/A peak": ("K_t_peak", 1e-3)}, ""),
    Question("emf_constant", "EMF (voltage) constant; beside a torque constant it is a check", "motor", _EMF, ""),
    Question("resistance", "winding resistance", "motor", {
        "Ohm line": ("R_line_to_line", 1.0), "Ohm phase": ("R", 1.0)}),
    Question("inductance", "winding inductance (of the d axis, if the next one differs)", "motor", {
        "mH line": ("L_line_to_line_mH", 1.0), "mH phase": ("L_mH", 1.0)}),
    Question("inductance_q", "inductance of the q axis, if it differs (interior magnets)", "motor", {
        "mH line": ("L_q_line_to_line_mH", 1.0), "mH phase": ("L_q_mH", 1.0)}, ""),
    Question("inertia", "rotor inertia, brake and coupling included", "motor", {
        "kg cm2": ("J_kg_cm2", 1.0), "g cm2": ("J_g_cm2", 1.0), "kg m2": ("J", 1.0)}),
    Question("load_inertia", "load inertia at the load's own shaft", "load", {
        "kg cm2": ("J", 1e-4), "g cm2": ("J", 1e-7), "kg m2": ("J", 1.0)}, ""),
    Question("gear", "gear ratio, motor turns per load turn", "load", {}, ""),
    Question("current_limit", "current limit of the drive", "drive", {
        "A rms": ("i_max_rms", 1.0), "A peak": ("i_max", 1.0)}),
    Question("supply", "dc link, or the mains that is rectified into it", "drive", {
        "V dc": ("u_dc", 1.0), "V ac": ("u_dc", math.sqrt(2.0))}, "560 V dc"),
    Question("pwm", "PWM rate = rate of the current controller", "drive", {
        "kHz": ("f_control", 1e3), "Hz": ("f_control", 1.0)}, "16 kHz"),
    Question("speed_loop", "rate of the speed controller", "drive", {
        "kHz": ("speed_rate", 1e3), "Hz": ("speed_rate", 1.0)}, "4 kHz"),
    Question("encoder", "encoder resolution", "sensor", {
        "bit": ("bits", 1.0), "counts": ("encoder_counts", 1.0), "lines": ("encoder_counts", 4.0)}, "20 bit"),
    Question("friction", "friction torque, if the sheet has one", "coulomb", {
        "N m": ("F_c", 1.0), "mN m": ("F_c", 1e-3)}, "0 N m"),
    Question("viscous", "viscous damping, if the sheet has one", "viscous", {
        "N m s/rad": ("F_v", 1.0), "N m/(rad/s)": ("F_v", 1.0), "N m/krpm": ("F_v", 1.0 / KRPM),
        "mN m s/rad": ("F_v", 1e-3), "mN m/(rad/s)": ("F_v", 1e-3), "mN m/krpm": ("F_v", 1e-3 / KRPM)}, "0 N m s/rad"),
)  # fmt: skip


_BY_KEY = {question.key: question for question in QUESTIONS}
# Questions for a machine without winding data: a rotary one has the motor's questions without the electrical ones, a
# linear one the same quantities along a line, and those of a winding where its pole pitch is known.
_PLAIN = (
    Question("torque_constant", "torque constant", "motor", {
        "N m/A peak": ("K_t", 1.0), "N m/A rms": ("K_t", math.sqrt(0.5)), "N m/A dc": ("K_t", 1.0)}),
    *(_BY_KEY[key] for key in ("inertia", "load_inertia", "gear")),
    replace(_BY_KEY["pole_pairs"], text="pole pairs, if known: they tell electrical orders", default=""),
    replace(_BY_KEY["current_limit"], default=""),
    *(_BY_KEY[key] for key in ("encoder", "friction", "viscous")),
)  # fmt: skip
PITCH = "pole_pitch"
_EMF_ALONG = {unit.replace("(rad/s)", "(m/s)"): found for unit, found in _EMF.items() if unit.endswith("(rad/s)")}
_LINEAR = (
    Question(PITCH, "pole pitch, N to S, of a motor whose windings are known", "motor", {
        "mm": ("pitch", 1e-3), "m": ("pitch", 1.0)}, ""),
    Question("torque_constant", "force constant", "motor", {
        "N/A peak": ("K_t", 1.0), "N/A rms": ("K_t", math.sqrt(0.5)), "N/A dc": ("K_t", 1.0)}, ""),
    replace(_BY_KEY["emf_constant"], units=_EMF_ALONG, beside=PITCH,
            text="EMF (voltage) constant; beside a force constant it is a check"),
    *(replace(_BY_KEY[key], beside=PITCH) for key in ("resistance", "inductance", "inductance_q")),
    Question("inertia", "moving mass, all of it", "motor", {"kg": ("J", 1.0), "g": ("J", 1e-3)}),
    replace(_BY_KEY["current_limit"], default=""),
    *(replace(_BY_KEY[key], beside=PITCH) for key in ("supply", "pwm", "speed_loop")),
    Question("encoder", "scale, its step or its counts", "sensor", {
        "um": ("step", 1e-6), "nm": ("step", 1e-9), "counts/mm": ("encoder_counts", 1e3)}, "1 um"),
    Question("friction", "friction force, if the sheet has one", "coulomb", {"N": ("F_c", 1.0)}, "0 N"),
    Question("viscous", "viscous damping, if the sheet has one", "viscous", {
        "N s/m": ("F_v", 1.0), "N/(m/s)": ("F_v", 1.0)}, "0 N s/m"),
)  # fmt: skip
MACHINES: dict[str, tuple[Question, ...]] = {"motor": QUESTIONS, "plain": _PLAIN, "linear": _LINEAR}
