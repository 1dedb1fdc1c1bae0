"""What a recording must hold, by command: the list of `init`, `import` and of the next experiment."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass

__all__ = ["NEEDS", "RECORD", "Need"]

# One sentence for whoever sets up a recorder.
RECORD = (
    "position and speed (theta, omega) and the torque-producing current (i_q, or torque); their references (theta_ref, "
    "omega_ref, i_q_ref) too, without which verify, quadrants and frf cannot answer; u_d, u_q and i_d for effects on "
    "the voltage; constant rate, at least 500 Hz; 1.3 s of rest at the end"
)


@dataclass(frozen=True)
class Need:
    """The channels that a command needs.

    Attributes
    ----------
    command : str
    channels : tuple of tuple of str
        One of each is needed, the first one best.
    why : str
        What for, where the command does without.
    """

    command: str
    channels: tuple[tuple[str, ...], ...]
    why: str = ""

    def lacking(self, channels: Container[str]) -> tuple[tuple[str, ...], ...]:
        """Return the alternatives of which a log has none.

        Parameters
        ----------
        channels : container of str
            Of the log.
        """
        return tuple(some for some in self.channels if not any(name in channels for name in some))


_MOTION, _DRIVE, _REFERENCE = ("theta", "omega"), ("i_q", "torque"), ("omega_ref", "theta_ref")
NEEDS = (
    Need("identify, compare, diagnose, track", (_MOTION, _DRIVE)),
    Need("compare", (("i_d",), ("i_q",), ("u_d",), ("u_q",)), "the voltages, and effects on them"),
    Need("compare", (_REFERENCE,), "the drive in closed loop, with loops in the design"),
    Need("frf", (_MOTION, _DRIVE, ("i_q_ref",), ("omega_ref",)), "with an excitation, without bias by noise"),
    Need("verify", (_REFERENCE, _MOTION, ("i_q_ref", "i_q", "torque"))),
    Need("quadrants", (("theta_ref",), ("theta",))),
)
