"""Every threshold of the room, with its unit and its reason.

Set on the clean logs of seeds 200 to 400 of `tests.benchmarks.worlds` and on the rows of
`tests.benchmarks.spoiled_logs`; the measured sets of the tests were looked at afterwards.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

__all__ = ["POLICY", "Policy"]


@dataclass(frozen=True)
class Policy:
    """What a sound log may show.

    Attributes
    ----------
    limit : mapping of str to float
        Factor by which a coefficient of a sound log may differ from the design: a resistance doubles when hot, an
        inertia is a guess, a flux is known to a tenth and a loss of 25 % is a damage, an inductance saturates.
    spread : mapping of str to float
        Usual scatter of the logarithm of that factor, with which one cause is weighed against another.
    together : float
        Gain in squared spreads from which on another number of pole pairs is believed, though no ratio is strange.
    least_t : float
        Standard errors below which a coefficient says nothing, its sign included.
    wrong_sign : float
        What a wrong sign adds to a sum of squared deviations: as much as ten spreads.
    as_good : float
        Sum of squared deviations by which another reading may be worse, and still be said.
    alone : float
        Preference for a cause that explains several coefficients over one that explains its own.
    unexplained : float
        Share of the torque's power that a foreign channel leaves at least.
    expected : float
        Least share of the torque's power that the design's inertia would make, for its absence to mean anything.
    swap_limit : float
        Factor by which the coefficient of an exchanged channel may differ from the design's.
    swap : float
        What exchanged channels leave at most of what the channels as logged leave.
    fold : float
        What a channel leaves at most, its expected sign taken away, of what it leaves with it.
    late : float
        s; a channel that is later than this, and than `late_periods`, is not taken in the same tick.
    late_periods : float
    late_errors : float
        Standard errors by which a lag exceeds both: with one, a wave of a turn makes a slow drive 10 ms late.
    late_gain : float
        What the shifted channel leaves at most of what the channel as logged leaves.
    same_delay : float
        Relative difference of a delay that is read at two neighbouring lags: 0.4 to 2 % of delays of 9 to 60 ms, 8 and
        12 % of a friction that bends before it slides.
    well : float
        Share of the torque's power below which no other lag is tried.
    longest_lag : float
        s.
    cut : float
        Usual steps of the angle that a missing piece of a log makes at least; less is a few lost samples.
    most_cuts : int
        More jumps are another thing.
    lost_samples : float
        Share of steps that are twice as long as their neighbours, from which on samples are missing.
    few_lost : float
        Share up to which the samples around the jumps of the speed that they make can be left out, and the rest judged.
    counts : float
        Counts of the encoder that the axis has to move in a sample for a lost one to show.
    held : float
        s; the slowest speed loops hold a torque command for 2 ms.
    held_periods : int
    held_reference : float
        s; the usual cycles of a fieldbus are up to 2 ms. A log of such a period or a longer one may be in step with it.
    fastest_loop : float
        Hz, of a current loop. In 58 clean worlds logged at 250 Hz with voltages eight show a flux linkage off by more
        than 7 %. Their viscous friction allows for it in all eight with this, in four with a quarter of it.
    jitter : float
        Periods; stamps that are off by more are no jitter of a clock, but pauses.
    clipped_share : float
        Share of a window at the limit from which on it is judged.
    clipped_bins : int
        Windows with samples at the limit that are needed to tell a clipped channel from a drive's limit.
    excess : float
        Share of the limit by which the motion needs more than it where a channel was clipped.
    few_clipped : float
        Per cent of the samples; with more of them clipped, what is left is chosen by its value, and no name is safe.
    most_clipped : float
        Share of the samples that may be clipped: without more of them a log says little of its drive.
    beyond : float
        s; a lag above it is taken out of the log, as no correction of the sampling instants reaches so far.
    sharper : float
        What one reading of a lag, delay or filter, has to leave at most of what the other leaves.
    offset : float
        Design's dry friction above which an offset of the current is worth a word.
    alike : float
        Relative difference of the offsets in torque and voltage that belong to one sensor.
    smoother : float
        What the roughness of the motion at equal steps may be of that at the stamps, for the stamps to be wrong.
    """

    limit: Mapping[str, float] = field(default_factory=lambda: {"J": 3.0, "R": 3.0, "psi_f": 1.32, "X": 2.5})
    spread: Mapping[str, float] = field(default_factory=lambda: {"J": 0.15, "R": 0.25, "psi_f": 0.06, "X": 0.2})
    together: float = 15.0
    least_t: float = 4.0
    wrong_sign: float = 100.0
    as_good: float = 3.0
    alone: float = 2.0
    unexplained: float = 0.5
    expected: float = 0.02
    swap_limit: float = 3.0
    swap: float = 0.25
    fold: float = 0.65
    late: float = 3e-3
    late_periods: float = 2.5
    late_errors: float = 2.0
    late_gain: float = 0.5
    same_delay: float = 0.05
    well: float = 0.02
    longest_lag: float = 0.12
    cut: float = 10.0
    most_cuts: int = 20
    lost_samples: float = 0.004
    few_lost: float = 0.02
    counts: float = 8.0
    held: float = 4e-3
    held_periods: int = 2
    held_reference: float = 2e-3
    fastest_loop: float = 2e3
    jitter: float = 40.0
    clipped_share: float = 0.1
    clipped_bins: int = 10
    excess: float = 0.06
    few_clipped: float = 0.5
    most_clipped: float = 0.05
    beyond: float = 6e-3
    sharper: float = 0.8
    offset: float = 0.5
    alike: float = 0.3
    smoother: float = 0.1


POLICY = Policy()
