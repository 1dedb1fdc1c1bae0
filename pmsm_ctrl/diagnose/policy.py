"""Every decision threshold of the diagnosis: value, unit, reason, and the benchmark that it was set on.

Benchmarks: *blind* is ``tests.benchmarks.blind`` (the package's own simulation), *plant* is
``tests.benchmarks.other_plant`` (a second simulator), *machines* and *sizes* are its motions of machines and its drives
of other sizes, *worlds* is ``tests.benchmarks.worlds`` (a third simulator, drives drawn at random), *clean* are logs
without a hidden effect.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from pmsm_ctrl.evidence.events import Search
from pmsm_ctrl.residuals.policy import SOUND

__all__ = ["POLICY", "Policy"]


@dataclass(frozen=True)
class Policy:
    """Thresholds of the diagnosis. Shares, ratios and counts have no unit.

    Attributes
    ----------
    significance : float
        Family-wise p-value of the F-test after Holm's correction, and of the size with the errors that are reported. A
        convention. Set on: clean.
    block_errors : float
        The mean cross-validation gain must exceed zero by this many standard errors; that of a minor effect with a
        memory by twice as many, and by as many beside its rivals. In 2,258 clean worlds minor gaps and presliding that
        pass all else reach 4.7, of seven that are there five have 6.1 to 17; a false one of 6.8 has 1.7 beside rivals.
        As many for a gap in doubt, or sized as a whole: of four false ones three have 3.2 to 4.0 and one 6.7.
        Set on: clean (docs/diagnosis.md); worlds.
    first_block_errors, expected_share : float
        The same for the first effect, which may be small. Its mean gain over its standard error must exceed
        `expected_share` times the root of its whole gain, and `first_block_errors` at least. Gains that are spread
        evenly over the blocks reach 0.5 times the root of the whole gain; three quarters of that are asked.
        `first_block_errors` alone are enough for a wave, or most of the residual, where half the band surely shows the
        same size. Later effects need the full `block_errors`: the model error of an accepted effect is in every block,
        and looks like a small effect. Set on: blind at half strength, and with effects left out of the candidates; half
        the band on worlds.
    rival_errors : float
        The mean cross-validation gain beside the rivals of an effect must exceed zero by this many standard errors.
        Rivals are late, averaged or filtered channels, and waves of a turn. Set on: worlds; blind (servo).
    size : float
        Smallest contribution that is named, as a share of the rms of the balance in which it acts. Set on: clean,
        blind.
    relative_size : float
        Smallest contribution that is named beside accepted effects, as a share of the largest contribution of theirs.
        Below it, the model error of the larger effect can look like another effect. Effects with an order of their own
        are exempt. Of 77 right second effects of pairs three are smaller, of 19 false ones ten. Set on: worlds.
    small_size, explained : float
        A contribution from `small_size` on is named where it explains at least the share `explained` of the residual's
        sum of squares: beside a hard acceleration all friction is small. Set on: machines; currents in steps of 60 mA,
        where an effect below `small_size` explains 58 % of the residual.
    above_floor : float
        Smallest share that an effect must explain of what the residual has above its noise floor: most of it. Sampling,
        filters and the current loop leave errors that are no noise, and any effect explains a little of them. For an
        effect without a memory the share of the prewhitened residual, or of the residual at the frequencies at which it
        acts, is enough. Of 128 right names in 144 worlds three have less, of nine false ones two. A parameter outside
        its tolerance is flagged where it explains as much where it acts: of 60 flags on wrong designs 54 stay by that,
        of twelve on right ones six. An effect with a memory is not judged where the axis turns too
        often for its direction in this share of the moving samples. Set on: worlds.
    excess : float
        Smallest share that is worth an answer. Where an effect explains less than that of the residual at the
        frequencies at which it acts, its share of the prewhitened residual does not count: three torque saturations
        were named so in 450 clean logs, and one effect of 128 in 144 worlds that was there. The same share of the
        residual makes a significant effect that cross-validation did not confirm unexplained structure. And a slow rest
        of the torque is structure from this share of its rms on: 110 logs of two simulators without a hidden effect
        have 0.13 at most, with a load of the process 0.14 to 0.60. Where nothing is named, an effect that explains this
        share of the excess may be, if it is surely of the same size in half the band. Set on: worlds.
    lowered : float
        An accepted effect must lower the rms error of at least one balance to this share of the error before. Without
        it a delay is named in a speed that the drive filtered, and in an angle of five digits. Set on: plant.
    balance_worse, traded : float
        The weighted rms error of a balance may not rise with an effect by more than the ratio `balance_worse`, unless
        its rise is less than the share `traded` of what another balance gains; so of the voltages, all samples alike,
        beyond `unchanged`. Set on: blind, pair 11106, where a third effect raised an error fivefold.
    unchanged : float
        Ratio of rms errors, all moving samples alike, up to which an effect leaves an error as it was. What is more
        raises it: for an effect on the voltages that of any of them, for one on the torque that over the samples that
        are known well, or over all of them. Set on: worlds; machines, where a dead time of 0.02 V was named.
    left_inside : float
        Share of what an effect explains that must be left when no base parameter leaves its bounds: most of it. So much
        of what a gap explains must be left beside its rivals, or `refused_share` where cross-validation beside them
        exceeds zero by `block_errors`: of 58 gaps that are there one has neither; eleven in 4,000 clean logs, four of
        which have neither, keep 0.19 to 0.42, but for two. A gap is sized as a whole where its part beyond the noise
        explains this share of it. A common course around reversals is unexplained structure where this share of it is
        left beside the path of the drive signal. A convention.
    returned, impossible : float
        Sum of squares, in tolerances, by which the winding returns to its datasheet with an effect, or the levels of
        several records to each other. A return of more than `returned` is reported, and no error has to fall then. For
        one of more than `impossible` (15 tolerances: no motor has four times the resistance of its datasheet) any
        cross-validation gain is enough; a winding that stays so far off is unexplained structure. Set on: blind on a
        slow sine, where a dead time looks like a resistance; worlds.
    tied_gain, tied_share : float
        Two explanations are equal where their sums of squares differ by less than `tied_gain`, in units of the noise,
        or by less than the share `tied_share` of the gain. An effect on a salient motor must explain more, by that
        share, than a ripple of the current. Set on: blind.
    most_steps : int
        Largest number of accepted effects. Set on: LAAS, where more than eight orders of cogging make the friction
        negative.
    rival_share, most_rivals : float, int
        Where a single effect was accepted, up to `most_rivals` others are fitted in its place, if their gain is at
        least the share `rival_share` of its gain. Set on: plant.
    sure_errors : float
        Standard errors beyond which a parameter deviates from its nominal value, its tolerance or its bounds. With
        four, a delay is named in one of 56 clean logs. The size that a shape carries must exceed zero by as many: of 27
        right names of presliding the smallest is 6, of four false ones three have 0.4 to 2.2.
    tolerance : float
        Tolerance of a parameter that has no usual one, where the design states none, as a share. Hot copper, or a
        resistance measured between two phases, is one and a half times or twice the design's.
    torque_constant : float
        Tolerance of a torque constant that the design assumes beside psi_f, as a share, which scales every torque. It
        is less than a datasheet's.
    sound_weight : float
        Samples of less weight are not searched for structure, and do not count where the error with and without an
        effect is compared: edges of the torque are aliased. Set on: a speed sweep; a friction that is an offset at one
        speed each way.
    structure_share : float
        Smallest share of the residual's mean square that a curve over a coordinate must explain to be named. Set on:
        clean.
    resembled_at_turns : float
        Smallest share of the residual that makes a refused effect unexplained structure where the residual sits around
        reversals. No sampling causes that; a presliding left out of the candidates resembles a Stribeck curve there for
        3 to 5 %. Set on: blind.
    around_reversals : float
        Ratio of the rms residual around reversals to that elsewhere above which the residual is said to sit there; and
        of the one at edges of the torque to that at edges elsewhere above which it is no error of edges. Set on: blind.
    visible_share : float
        Smallest share of the motion that must be slow enough for the lowest usual order of an effect to pass the
        filter. Set on: blind.
    own_share : float
        Smallest share of a friction column that must be independent of the others for its parameter to count as
        excited; and of its way that an axis has to go back for a load to be told from friction. Set on: blind.
    separated : float
        Twice the log-likelihood by which one rival must beat the other in the proposed experiment.
    explained_torque : float
        Smallest share of the torque's mean square that a model must explain for a verdict; for a name, of what is
        not noise, and as much beside what is. Less than this share of what is not noise: log and design do not belong
        together. Half, because with less most of the torque is
        something else. A log is also not called consistent where more than this share of its residual lies above the
        noise floor. Of 50 clean worlds eight have such a residual: edges that are not sampled, or a drive at its limit.
    implausible_factor : float
        J, R or psi_f that differ from the design's by more than this factor contradict it: another unit, another gear
        or another axis.
    stable : float
        Smallest share of an effect's amount in the band that half of it has to show, the standard errors of
        `sure_errors` allowed for. The size of an effect does not hang on the band; that of an error of the model does.
        Of 60 right names in worlds none has less than 0.66, of 13 false ones in clean worlds one has more than 0.11.
        By as much of itself the amount may surely exceed the one in the band, unless it is that of a spring, of a
        bristle or of a minor gap: of 310 right names none does, of 38 false ones in clean worlds four.
        Where an effect is a minor part of the residual, the amount must surely be more than this share, and less than
        its inverse. Parts of the way that do not confirm a wave have to be this share as sure of it as parts of the
        time are: a weak wave has 0.75, three false ones in motions that repeat themselves 0.14 to 0.28.
    friction_share : float
        A dry friction below zero contradicts the design if it is at least this share of the torque. A smaller one is
        held at zero: something else is missing. A convention.
    refused_share : float
        Share of the residual's mean square that is too large to be passed over. Nine rules use it. A significant
        effect that was refused and explains this share forbids `consistent`. An effect that explains this share, and
        most of what the residual has above its noise floor, may be named however small it is. One with a memory that
        shows in half the usual band alone is named where it explains this share there. Where the noise floor is less
        than this share, all samples weighted alike, the log is not called consistent; one clean world in ten has such
        edges. Nor where the axis turns back and forth in more than this share of the moving samples. An order of a turn
        has to explain this share at other speeds than one, or its turns there leave a smaller chance than it: of six
        false coggings one does. Where it is less than this share as the fit weighs it, a residual of most of the torque
        contradicts the design. Set on: worlds.
    events : Search
        What counts as an event. Found: pushes, brakes and steps of 0.7 F_c in 14 worlds. False: one in 160 worlds
        without an event.
    alarms : float
        Share of false alarms in the simulated calibration above which the result has a warning. A convention.
    """

    significance: float = 0.01
    block_errors: float = 2.8
    first_block_errors: float = 2.0
    expected_share: float = 0.375
    rival_errors: float = 1.0
    size: float = 0.004
    relative_size: float = 0.06
    small_size: float = 0.001
    explained: float = 0.012
    above_floor: float = 0.5
    excess: float = 0.2
    lowered: float = 0.985
    balance_worse: float = 1.03
    traded: float = 0.2
    unchanged: float = 1.001
    left_inside: float = 0.5
    returned: float = 25.0
    impossible: float = 225.0
    tied_gain: float = 20.0
    tied_share: float = 0.01
    most_steps: int = 8
    rival_share: float = 0.6
    most_rivals: int = 3
    sure_errors: float = 3.0
    tolerance: float = 0.15
    torque_constant: float = 0.02
    sound_weight: float = SOUND
    structure_share: float = 0.015
    resembled_at_turns: float = 0.025
    around_reversals: float = 1.5
    visible_share: float = 0.1
    own_share: float = 0.02
    separated: float = 30.0
    explained_torque: float = 0.5
    implausible_factor: float = 3.0
    stable: float = 0.5
    friction_share: float = 0.1
    refused_share: float = 0.1
    events: Search = field(default_factory=Search)
    alarms: float = 0.05

    def tie(self, gain: float, scatter: float = 1.0) -> float:
        """Return the largest difference of the sums of squares of two explanations that are equal.

        Parameters
        ----------
        gain : float
            Fall of the sum of squares by either, in units of the noise.
        scatter : float
            Mean square of what both leave, in the same units, and at least 1.
        """
        return max(self.tied_gain * scatter, self.tied_share * gain)


POLICY = Policy()
