"""Every decision threshold of the diagnosis: value, unit, reason, and the benchmark that it was set on.

Benchmarks: *blind* is ``tests.benchmarks.blind`` (the package's own simulation), *plant* is
``tests.benchmarks.other_plant`` (a second simulator), *machines* and *sizes* are its motions of machines and its drives
of other sizes, *clean* are logs of both without a hidden effect.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from pmsm_ctrl.evidence.events import Search

__all__ = ["POLICY", "Policy"]


@dataclass(frozen=True)
class Policy:
    """Thresholds of the diagnosis. Shares, ratios and counts have no unit.

    Attributes
    ----------
    significance : float
        Family-wise p-value of the F-test after Holm's correction. A convention; clean.
    block_errors : float
        Standard errors by which the mean cross-validation gain must be above zero. False-alarm table of
        docs/diagnosis.md; clean.
    first_block_errors, expected_share : float
        The same for the first effect, which may be small: this share of the root of its whole gain is enough, and never
        less than so many standard errors. Gains that are spread evenly over the blocks reach half the root of the
        whole; three quarters of that must be seen. Later effects need the full number: what an accepted effect does not
        describe exactly is left in every block, and can look like a small effect. Blind at half strength, and with
        effects left out of the candidates.
    rival_errors : float
        Standard errors by which the mean cross-validation gain of a spring or a gap must be above zero beside a smooth
        response and waves of a turn, where it also must be significant. Third simulator; blind (servo).
    size : float
        Smallest contribution worth a name, as a share of the rms of the balance where it acts. Clean, blind.
    beside : float
        Smallest contribution worth a name beside accepted effects, as a share of the largest of theirs: no model of an
        effect is exact, and what it leaves looks like another one. Of 77 right second effects of pairs three are
        smaller, of 19 false ones ten. Effects with an order of their own are known by that. Worlds.
    small_size, explained : float
        A smaller contribution is enough where it explains this share of the residual's sum of squares: beside a hard
        acceleration all friction is small. Machines; currents in steps of 60 mA, where less than that is 58 % of the
        residual.
    excess : float
        Share that an effect must explain of what the residual has above its noise floor. What a sampling, a filter or
        a current loop leaves is no noise, and any effect explains a little of it. A significant effect that was not
        confirmed by cross-validation, and explains this share of the residual, is unexplained structure. Worlds.
    with_memory : float
        The same for a spring, a gap, a bristle or a delay: what lies between the logged drive signal and the torque
        has a memory as well, and no model of it is exact. Worlds.
    lowered : float
        An accepted effect must bring the rms error of at least one balance down to this share. Plant: a speed that the
        drive filtered, and an angle of five digits, let a delay pass without it.
    balance_worse, traded : float
        Ratio by which the weighted rms error of a balance may rise with an effect, and more only where that is less
        than this share of what another balance gains. Blind, pair 11106: a third effect raised an error fivefold.
    worse : float
        Ratio by which an effect on the voltages may raise the rms error of a voltage. Machines: a dead time of 0.02 V.
    unchanged : float
        Ratio of rms errors, all moving samples alike, up to which an effect on the torque leaves its error as it was.
        What is more raises an error. Worlds drawn at random.
    left_inside : float
        Share of what an effect explains that must be left when no base parameter leaves its bounds: most of it. A
        convention.
    relief, absurd : float
        Sum of squares, in tolerances, by which the winding returns to its datasheet with an effect, or the levels of
        several records to each other. From `relief` on that is reported, and no error has to fall; from `absurd` on (15
        tolerances: no motor has four times the resistance of its datasheet) any cross-validation gain is enough, and a
        winding so far off is unexplained. Blind on a slow sine, where a dead time is as well a resistance; worlds.
    tied_gain, tied_share : float
        Two explanations are equal where their sums of squares differ by less than this, in units of the noise, or by
        less than this share of the gain. Blind.
    most_steps : int
        Effects that are accepted at most. LAAS: beyond eight orders of its cogging the friction becomes negative.
    rival_share, most_rivals : float, int
        Where a single effect was accepted, so many others whose gain is at least this share of its gain are fitted in
        its place. Plant.
    sure_errors : float
        Standard errors from which on a parameter deviates: from its nominal value, its tolerance or its bounds. With
        four, a delay is named in one of 56 clean logs.
    tolerance : float
        Tolerance of a parameter for which the design gives none, as a share: copper that is hot, or measured between
        two phases, is one and a half times or twice the design's.
    torque_constant : float
        Share by which the torque constant may be off, which scales every torque: less than on a datasheet.
    sound_weight : float
        Weight below which a sample is not searched for structure, and does not tell whether an effect raises an error:
        edges of the torque are aliased. A speed sweep; a friction that is an offset at one speed each way.
    structure_share : float
        Least share of the residual's mean square that a curve must explain to be named. Clean.
    resembled_at_turns : float
        The share of such structure where the residual sits around reversals, as no sampling leaves it: presliding
        left out of the candidates is a Stribeck curve for 3 to 5 % of it. Blind.
    around_reversals : float
        Ratio of rms residuals around reversals and elsewhere from which on the structure is said to sit there. Blind.
    visible_share : float
        Share of the motion that must be slow enough for an effect's lowest usual order to pass the filter. Blind.
    own_share : float
        Share of a column that must be its own for its friction parameter to count as excited. Blind.
    separated : float
        Twice the log-likelihood by which one rival must beat the other in the proposed experiment.
    explained_torque : float
        Share of the torque's mean square that a model must explain; of what is not noise, or else log and design do
        not belong together. Half: with less, most of the torque is something else. A residual of which more than this
        share lies above its noise floor is not called consistent: all candidates together explain most of it. Of 50
        clean worlds eight have such a residual, where edges are not sampled or the drive runs into its limit.
    implausible_factor : float
        Factor by which J, R or psi_f cannot differ from the design's: another unit, another gear, another axis.
    friction_share : float
        Share of the torque from which on a dry friction below zero contradicts the design; with less it stays at zero,
        and something else is missing. A convention.
    refused_share : float
        Share of the residual that a significant effect would explain that was refused: a log is not called consistent
        then. An effect that explains so much, and most of what the residual has above its noise floor, is worth a name
        however small. A torque of which noise is at least this share may be noise, and contradicts no design; where it
        is less with edges weighted as all other samples, the log is not called consistent either: one clean world in
        ten has such edges. Worlds.
    events : Search
        What counts as an event. Pushes, brakes and steps of 0.7 F_c in 14 worlds; one named in 160 worlds without.
    alarms : float
        Share of false alarms in the simulated calibration from which on the answer is doubted. A convention.
    """

    significance: float = 0.01
    block_errors: float = 2.8
    first_block_errors: float = 2.0
    expected_share: float = 0.375
    rival_errors: float = 1.0
    size: float = 0.004
    beside: float = 0.06
    small_size: float = 0.001
    explained: float = 0.012
    excess: float = 0.2
    with_memory: float = 0.5
    lowered: float = 0.985
    balance_worse: float = 1.03
    traded: float = 0.2
    worse: float = 1.1
    unchanged: float = 1.001
    left_inside: float = 0.5
    relief: float = 25.0
    absurd: float = 225.0
    tied_gain: float = 20.0
    tied_share: float = 0.01
    most_steps: int = 8
    rival_share: float = 0.6
    most_rivals: int = 3
    sure_errors: float = 3.0
    tolerance: float = 0.15
    torque_constant: float = 0.02
    sound_weight: float = 0.5
    structure_share: float = 0.015
    resembled_at_turns: float = 0.025
    around_reversals: float = 1.5
    visible_share: float = 0.1
    own_share: float = 0.02
    separated: float = 30.0
    explained_torque: float = 0.5
    implausible_factor: float = 3.0
    friction_share: float = 0.1
    refused_share: float = 0.1
    events: Search = field(default_factory=Search)
    alarms: float = 0.05

    def tie(self, gain: float) -> float:
        """Return by how much two explanations of so large a gain may differ and still be equal.

        Parameters
        ----------
        gain : float
            Fall of the sum of squares, in units of the noise.
        """
        return max(self.tied_gain, self.tied_share * gain)


POLICY = Policy()
