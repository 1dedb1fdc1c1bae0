"""What a loop has to keep to be called defended."""

from __future__ import annotations

from dataclasses import dataclass

from pmsm_ctrl.tune.margins import Margins

__all__ = ["Requirements"]


@dataclass(frozen=True)
class Requirements:
    """Least margins, nominal or at the worst corner of the tolerances.

    Attributes
    ----------
    phase_margin : deg
    gain_margin_db : dB
    sensitivity_peak : largest abs(S) granted; 2 is 6 dB, a distance of 0.5 from the critical point
    """

    phase_margin: float = 30.0
    gain_margin_db: float = 6.0
    sensitivity_peak: float = 2.0

    def missed(self, found: Margins) -> tuple[str, ...]:
        """Return what a loop misses, in words; empty when it keeps everything."""
        if found.stable is False:
            return ("unstable",)
        out = []
        if found.phase_margin < self.phase_margin:
            out.append(f"phase margin {found.phase_margin:.1f} deg < {self.phase_margin:g} deg")
        if found.gain_margin_db < self.gain_margin_db:
            out.append(f"gain margin {found.gain_margin_db:.1f} dB < {self.gain_margin_db:g} dB")
        if found.sensitivity_peak > self.sensitivity_peak:
            out.append(f"sensitivity peak {found.sensitivity_peak:.2f} > {self.sensitivity_peak:g}")
        return tuple(out)

    def shortfall(self, found: Margins) -> float:
        """How far a loop is from its worst requirement: positive when one is missed; for ranking."""
        if found.stable is False:
            return float("inf")
        return max(
            (self.phase_margin - found.phase_margin) / 30.0,
            (self.gain_margin_db - found.gain_margin_db) / 6.0,
            found.sensitivity_peak / self.sensitivity_peak - 1.0,
        )
