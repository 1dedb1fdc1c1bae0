"""Break the heart on purpose and see that the fast suite catches it: ``python -m tests.benchmarks.mutations``.

Every mutation changes one line in a copy of the tree and runs the tests named with it, which pass on the unchanged tree
and are part of what the README's command runs. The exit status is 1 where one is not caught.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Mutation:
    """One change: what it breaks, the file inside the package, the text and what takes its place, and the tests."""

    what: str
    file: str
    old: str
    new: str
    tests: str


MUTATIONS = (
    Mutation("sign of a friction term", "effects/viscous.py",
             "return F_v * omega", "return -F_v * omega", "unit/test_effects.py -k viscous"),
    Mutation("sign of the induced voltage", "kernels/balance.py",
             "p * omega * (L_d * i_d + psi_f)", "p * omega * (L_d * i_d - psi_f)", "unit/test_docs.py -k textbook"),
    Mutation("threshold: significance 0.01 -> 0.1", "diagnose/policy.py",
             "significance: float = 0.01", "significance: float = 0.1", "unit/diagnose/test_criteria.py"),
    Mutation("threshold: three standard errors of cross-validation -> one", "diagnose/criteria.py",
             "found.gain > asked * found.stderr", "found.gain > found.stderr", "unit/diagnose/test_criteria.py"),
    Mutation("column: what does not hang on the parameter stays in", "effects/evaluate.py",
             " - _{which}_0_{row}", "", "unit/test_effects.py -k split"),
    Mutation("column of another record is remembered", "regression/columns.py",
             "not MODELLED.isdisjoint(effect.structure.reads", "False and MODELLED.isdisjoint(effect.structure.reads",
             "unit/regression/test_columns.py"),
    Mutation("unit: a speed in rpm", "units.py",
             "2.0 * math.pi / 60.0", "math.pi / 60.0", "unit/test_units.py"),
    Mutation("unit: the encoder of a linear axis counts by 2 pi m", "units.py",
             "return 1.0 if motion == \"linear\" else 2.0 * math.pi", "return 2.0 * math.pi",
             "unit/simulate/test_linear_axis.py -k metre_over"),
    Mutation("motion: the lengths of a linear axis are metres", "simulate/motions.py",
             "length=length, steady", "steady", "unit/simulate/test_linear_axis.py -k motor_can_do"),
    Mutation("filter: cutoff at half its frequency", "regression/filters.py",
             "butter(4, cutoff, fs=rate", "butter(4, 0.5 * cutoff, fs=rate", "unit/regression"),
    Mutation("filter: one more step of delay in the derivative", "kernels/filters.py",
             "values[reach - j - 1 :]", "values[reach - j :]", "unit/regression"),
    Mutation("sampling: in step with a held reference", "regression/sampling_terms.py",
             "if record.in_step:\n", "if False:\n", "unit/diagnose/test_in_step.py"),
    Mutation("weight: edges count in full", "regression/weights.py",
             "by_variance(share * known", "by_variance(0.0 * known", "unit/regression/test_edge_share.py"),
    Mutation("weight: edges are as far off as a period allows", "regression/edge_share.py",
             "return float(min(SHARES, key=cost))", "return 1.0", "unit/regression/test_edge_share.py"),
    Mutation("weight: edges of a fast log are judged after thinning", "regression/weights.py",
             "if len(whole) == len(log) or times < 2:", "if True:", "unit/regression/test_weights.py"),
    Mutation("stepped: a bristle alone is a torque that is late", "regression/stepped_reversals.py",
             "> LOUD * tried[moment]:", "> 1e9 * tried[moment]:",
             "unit/regression/test_stepped_reversals.py -k no_delay"),
    Mutation("voltages: the drive's axes are those of the magnets", "regression/model.py",
             "ALIGNED = \"delta_frame\", 0.05", "ALIGNED = \"delta_frame\", 1e-9", "unit/diagnose/test_commutation.py"),
    Mutation("twins: what nothing tells apart is shared out", "regression/base_fit.py",
             "share < TWIN]", "share < 0.0]", "unit/regression/test_twins.py"),
    Mutation("angle: its error counts by the design's inertia", "regression/balances.py",
             "return self.found if self.found > 0.0", "return self.found if self.found > 1e9",
             "unit/diagnose/test_encoder_error.py"),
    Mutation("load: another inertia is always the rotor's", "design_parts.py",
             "else min(rotor, self.at_motor)", "else self.at_motor", "unit/regression/test_total_inertia.py"),
    Mutation("scale: a stated gain of the current stays in", "regression/measurement_correction.py",
             "/ float(2.0 - read[name][0])", "/ 1.0", "unit/regression/test_measurement_correction.py -k scale"),
    Mutation("states: a known bristle is no part of identify", "regression/base_problem.py",
             "target=record.target[0] - model.matrix", "target=record.target[0] + model.matrix",
             "unit/identify/test_known_states.py"),
    Mutation("stepped: friction of a fast log steps at a sample of the thinned one", "regression/stepped_reversals.py",
             "finer=finer,", "finer=1,", "unit/regression/test_stepped_reversals.py"),
    Mutation("stepped: friction that bends is a step that is late", "regression/stepped_reversals.py",
             "BENT = 0.7", "BENT = 70.0", "unit/regression/test_stepped_reversals.py"),
    Mutation("stepped: a torque that is late is in time", "plausibility/late_steps.py",
             "not timing.late > record.sampling", "True", "unit/regression/test_stepped_reversals.py"),
    Mutation("orders: few angles, passed again and again, tell any order", "residuals/orders.py",
             "(counts == len(angle)) | (orders", "True | (orders", "unit/residuals/test_orders.py"),
    Mutation("noise floor: without the steps of the encoder", "diagnose/level.py",
             "return max(sigma, known_noise(fit, row))", "return sigma", "unit/diagnose/test_verdict.py"),
    Mutation("weight: reversals count in full", "regression/weights.py",
             "return 1.0 / (1.0 + (wrong / noise) ** 2)", "return 1.0 / (1.0 + 0.0 * wrong)",
             "unit/regression/test_weights.py"),
    Mutation("sampling is no reason against a delay", "diagnose/selection.py",
             "judge_sampling(after, case.policy) or refusal", "refusal", "unit/diagnose/test_selection.py"),
    Mutation("gaps: sized by what is beyond the noise alone", "diagnose/judging.py",
             "(larger := sized(fit, trial, policy.left_inside)) is not trial", "(larger := trial) is not trial",
             "unit/diagnose/test_judging.py"),
    Mutation("gaps: no doubt where edges of the torque could be noise", "diagnose/judging.py",
             "minor_too = minor_too or in_doubt(fit, trial, policy.left_inside)\n", "pass\n",
             "unit/diagnose/test_unexplained.py -k twenty_periods"),
    Mutation("gaps: edges of the torque are noise", "effects/structures/gap.py",
             "min(balances.shaft_noise(), balances.noise_beside(values[0][:, 0]))", "balances.shaft_noise()",
             "unit/diagnose/test_load_noise.py -k behind_a_gap"),
    Mutation("gaps: sized as a whole though noise may be most of it", "diagnose/measures.py",
             "if part > least * all_of_it else", "if part > 0.0 else",
             "unit/diagnose/test_measures.py -k sized_as_a_whole"),
    Mutation("barely confirmed: half the band is not asked", "diagnose/selection.py",
             "or slight(fit, trial) or judged.barely", "or slight(fit, trial)", "unit/diagnose/test_selection.py"),
    Mutation("narrower bands: any effect with a memory is one that noise hid", "diagnose/other_bands.py",
             "refusal.reason in BESIDE_NOISE", "True", "unit/diagnose/test_bands.py -k noise_hid"),
    Mutation("waves: of any size above the band", "diagnose/selection.py",
             "refusal = refusal or unlike_above(case, after)\n", "pass\n",
             "unit/diagnose/test_bands.py -k line_of_the_encoder"),
    Mutation("orders: lines of the encoder are waves of the torque", "regression/fast_orders.py",
             "np.where(of_angle & (unanswered > 0.0), 0.0,", "np.where(of_angle & (unanswered < 0.0), 0.0,",
             "unit/regression/test_fast_orders.py -k line_of_the_encoder"),
    Mutation("bands of springs: one that rings beyond them counts", "diagnose/other_bands.py",
             " <= case.record.cutoff", " <= 1e9", "unit/diagnose/test_bands.py -k rings"),
    Mutation("bands of springs: one that rings inside the usual band counts", "diagnose/other_bands.py",
             "EDGE * usual <= resonance", "0.0 <= resonance", "unit/diagnose/test_bands.py -k rings"),
    Mutation("bands of springs: looked in whatever the usual band shows", "diagnose/other_bands.py",
             "if name in shown and resonance is not None", "if resonance is not None",
             "unit/diagnose/test_bands.py -k spring"),
    Mutation("minor effects: never looked for", "diagnose/other_views.py",
             "if any(why", "if not any(why", "unit/diagnose/test_selection.py"),
    Mutation("written: an effect may raise the error of its design", "diagnose/written.py",
             "case.policy.unchanged * left[kept - 1]", "1e3",
             "unit/diagnose/test_lowering.py"),
    Mutation("written: smoothed noise is a gain of the design without an effect", "diagnose/written.py",
             "alike if alike.torque_error[0] > after", "alike if False", "unit/diagnose/test_lowering.py"),
    Mutation("gravity behind a gear: parts of the travel are not tried", "effects/load_gravity.py",
             "(stated, *(travel / part for part in PARTS))", "(stated,)", "unit/diagnose/test_load_gravity.py"),
    Mutation("gravity behind a gear: a saturation is no rival", "effects/structures/interface.py",
             "(bent_torque(balances) if turned else ())", "()", "unit/diagnose/test_load_gravity.py"),
    Mutation("identify: a friction that falls is a torque in step", "regression/base_problem.py",
             "min(LOWERED * _left(found), _left_by_curves(found))", "LOWERED * _left(found)",
             "unit/identify/test_effective.py"),
    Mutation("lowering: beside a fit that is astray", "diagnose/written.py",
             "return given**2 < case.policy", "return given**2 < 0.0 * case.policy", "unit/diagnose/test_lowering.py"),
    Mutation("lowering: nothing beside a fit that is astray", "diagnose/written.py",
             "left[-1] ** 2 >= enough", "1e9 >= enough", "unit/diagnose/test_lowering.py"),
    Mutation("floor of joined records: that of the quietest", "diagnose/level.py",
             "    if record.counts:\n", "    if False:\n", "unit/diagnose/test_several_logs.py"),
    Mutation("detent force: both parts are sines", "effects/detent_force.py",
             "a_c * cos(", "a_c * sin(", "unit/diagnose/test_detent_force.py"),
    Mutation("detent force: no wave that fades with the speed", "diagnose/candidates.py",
             "        if not record.linear:\n            return slow", "        if True:\n            return slow",
             "unit/diagnose/test_detent_force.py"),
    Mutation("waves over a position: those of less than four periods", "evidence/waves.py",
             "peaks >= PERIODS * FINER", "peaks >= 0", "unit/evidence/test_waves.py"),
    Mutation("zeros: a held-out record keeps its own", "regression/one_axis.py",
             "return with_zero_of(*(Source.of(one, base_fit(bare, one)) for one in (other, record)))", "return other",
             "unit/diagnose/test_several_logs.py -k held_out_record_may"),
    Mutation("zeros: waves of the design hide them", "regression/one_axis.py",
             "bare = _without_waves(design)\n", "bare = design\n",
             "unit/diagnose/test_several_logs.py -k same_zeros"),
    Mutation("zeros: a ripple is a wave of constant size", "regression/position_waves.py",
             "both[part.by_torque] *= torque /", "both[part.by_torque] *= 1.0 + 0.0 * torque /",
             "unit/regression/test_angle_zero.py -k ripple"),
    Mutation("zeros: the noise holds the waves", "regression/position_waves.py",
             "clean[inside] -= value @ own", "clean[inside] -= 0.0 * value @ own",
             "unit/regression/test_angle_zero.py -k ripple"),
    Mutation("events: a step of which the motion explains nearly all is none", "evidence/events.py",
             "rules.nearly_all * float(target @ target)", "np.inf", "unit/diagnose/test_step_in_short_log.py"),
    Mutation("held channels: late by half of the hold", "plausibility/recorder.py",
             "late = 0.5 * (n - 1) * log.period", "late = 0.0", "unit/plausibility/test_held_channel.py"),
    Mutation("speed alone: a slow filter stays in", "regression/timed_record.py",
             "if errors[best] < LOWERED * left else", "if errors[best] < 0.0 else",
             "unit/diagnose/test_slow_speed_filter.py"),
    Mutation("compare: a single wave is noise", "compare/comparison.py",
             "wave.notice if wave else None", "None", "unit/compare/test_single_wave.py"),
    Mutation("a rotary log and a linear design", "plausibility/doubts.py",
             "log.motion != design.motion", "False", "unit/plausibility/test_kind_of_axis.py"),
    Mutation("a delay that a filter explains as well", "diagnose/judging.py",
             "if filtered else None", "if False else None", "unit/diagnose/test_judging.py"),
    Mutation("prediction: the inertia is that of the log", "regression/prediction.py",
             'design.J if model.names[k] == "J" else nominal[k]', "nominal[k]",
             "unit/regression/test_slow_inertia.py -k comparison"),
    Mutation("plausibility: a constant i_d is no part of the flux linkage", "plausibility/relations.py",
             "1.0 + usual * (motor.L_d or 0.0) / motor.psi_f", "1.0", "unit/plausibility/test_constant_current.py"),
    Mutation("plausibility: the weight of an arm makes its torque a foreign one", "plausibility/foreign.py",
             "    if _lifts(evidence, log):\n", "    if False:\n", "unit/plausibility/test_weight.py"),
    Mutation("fast torque: it may make an effect alone", "diagnose/selection.py",
             "like_ripple(case, fit, trial) or of_fast_torque(", "like_ripple(case, fit, trial) and of_fast_torque(",
             "unit/diagnose/test_selection.py"),
    Mutation("intervals: a lower sum of squares on the way is passed by", "diagnose/profiles.py",
             "if there.estimate.chi2 < most:", "if False:", "unit/diagnose/test_bounds.py -k optimum_inside"),
    Mutation("Holm: every rank pays for one test less", "evidence/tests.py",
             "(len(p_values) - rank)", "(len(p_values) - rank - 1)", "unit/evidence/test_tests.py"),
    Mutation("Holm: a later p-value may fall below an earlier one", "evidence/tests.py",
             "worst = max(worst, min(1.0", "worst = max(0.0, min(1.0", "unit/evidence/test_tests.py"),
    Mutation("F-test: degrees of freedom swapped", "evidence/tests.py",
             "fdtrc(k, dof, f)", "fdtrc(dof, k, f)", "unit/evidence/test_tests.py"),
    Mutation("prior: the datasheet's value is taken for zero", "regression/model.py",
             "model.nominal[known] / model.sigma[known]", "0.0 * model.nominal[known] / model.sigma[known]",
             "unit/regression/test_model.py"),
    Mutation("prior: tolerances twice as tight", "regression/model.py",
             "np.diag(1.0 / model.sigma[known])", "np.diag(2.0 / model.sigma[known])", "unit/regression/test_model.py"),
    Mutation("delay's sign", "effects/structures/delay.py",
             "np.clip(t + values[self.age]", "np.clip(t - values[self.age]",
             "unit/regression/test_measurement_correction.py"),
    Mutation("timing: the filter's slope with the wrong sign", "regression/drive_timing.py",
             "spline(ahead) + self.lag * spline(ahead, 1)", "spline(ahead) - self.lag * spline(ahead, 1)",
             "unit/regression/test_drive_timing.py -k undone"),
    Mutation("timing: the lateness may be anything", "regression/lateness.py",
             "if by is None and -record.early <= late <= record.sampling:", "if by is None:",
             "unit/regression/test_drive_timing.py -k no_filter"),
    Mutation("bound: parameters may not come near it", "diagnose/criteria.py",
             "low - slack <= value", "low + slack <= value", "unit/diagnose/test_criteria.py"),
    Mutation("order of acceptance: the worst candidate first", "diagnose/fit.py",
             "t.at_bound, -t.plain_gain)", "t.at_bound, t.plain_gain)",
             "unit/diagnose/test_bounds.py -k pole_pairs"),
    Mutation("order: cogging at the order next to it", "residuals/orders.py",
             "places, count = np.flatnonzero(self.seen),", "places, count = (np.flatnonzero(self.seen) + 1) % highest,",
             "unit/residuals/test_dependence.py -k orders"),
    Mutation("blocks: the gap is used to fit", "evidence/blocks.py",
             "[first - gap, last + gap]", "[first, last]", "unit/evidence/test_blocks.py"),
    Mutation("whitening: the level is that of the noise before it is whitened", "evidence/whitening.py",
             "np.sqrt(variances[order])", "np.sqrt(variances[0])", "unit/evidence/test_whitening.py"),
    Mutation("noise: its correction leaves out what both columns of a pair share", "evidence/noise.py",
             "left = inside - basis @ core", "left = inside", "unit/evidence/test_noise.py -k given_back"),
    Mutation("standard errors of independent samples", "regression/covariance.py",
             "stderr = np.sqrt(np.maximum(np.diag(covariance.of_fit()), 0.0))", "stderr = covariance.fit.stderr",
             "unit/regression/test_model.py"),
    Mutation("bounds: the free optimum is taken", "regression/bounds.py",
             "found = holding(free, held)", "found = free", "unit/regression/test_model.py"),
    Mutation("held-out record: a larger error passes", "diagnose/criteria.py",
             "sum(ratios) >= len(before) or", "sum(ratios) < len(before) or", "unit/diagnose/test_criteria.py"),
    Mutation("ties: everything is equivalent", "diagnose/look_alikes.py",
             "return left < tie or", "return left > tie or", "unit/diagnose/test_selection.py"),
    Mutation("ripple of the current: a drive in place of a drag", "regression/reluctance.py",
             "return -float(torque_em", "return float(torque_em", "unit/regression/test_reluctance.py"),
    Mutation("shapes: a size that is not determined passes", "diagnose/criteria.py",
             "if value <= policy.sure_errors * stderr", "if value <= 0.0 * stderr", "unit/diagnose/test_criteria.py"),
    Mutation("amplitudes: one that is not determined passes", "diagnose/criteria.py",
             "if p * len(free) * tried > policy.significance", "if p < 0.0",
             "unit/diagnose/test_criteria.py"),
    Mutation("amplitudes: shapes that were tried cost nothing", "diagnose/criteria.py",
             "if p * len(free) * tried > policy.significance", "if p * len(free) > policy.significance",
             "unit/diagnose/test_criteria.py"),
    Mutation("voltages: a loss proportional to the current is a dead time", "diagnose/final_fit.py",
             "if math.isinf(high):", "if math.isnan(high):", "unit/diagnose/test_shapes.py"),
    Mutation("errors: with nuisances that raise them", "diagnose/fit.py",
             "if better else values", "if not values.size else values",
             "unit/diagnose/test_reported_errors.py"),
    Mutation("response: the delay of the log with the wrong sign", "frf/fit.py",
             "np.exp(-1j * omega * values[2]", "np.exp(1j * omega * values[2]",
             "unit/frf/test_frf.py -k phase_that_wraps"),
    Mutation("response: what the recorder does is put on it and not taken off", "frf/measured.py",
             "taken.value / seen", "taken.value * seen", "unit/frf/test_frf.py -k recorder_and_window"),
    Mutation("together: what is left is noise, however much it is", "diagnose/level.py",
             "self.left**2 * (1.0 - policy.explained_torque) > 1.0", "self.left**2 < 0.0",
             "system/test_several_effects.py -k loses_its_name"),
    Mutation("together: nothing that was accepted before is judged again", "diagnose/together.py",
             "reversed(range(len(accepted))))", "reversed(range(len(found.steps), len(accepted))))",
             "system/test_several_effects.py -k loses_its_name"),
    Mutation("rank test: equal gains have ranks of their own", "evidence/tests.py",
             "(2 * np.cumsum(count) - count + 1)", "(2 * np.cumsum(count))", "unit/evidence/test_tests.py"),
    Mutation("margin: of several crossings the largest phase", "tune/margins.py",
             "int(np.argmin(np.abs(phase)))", "int(np.argmax(np.abs(phase)))",
             "unit/tune/test_margins.py -k python_control"),
    Mutation("response of a model: the rounding of its triangles stays", "tune/sampled.py",
             "states += solved(", "solved(", "unit/tune/test_margins.py -k all_frequencies"),
    Mutation("safe gain: no parameter is too high", "compensate/window.py",
             "FACTORS = (0.8, 1.0, 1.2)", "FACTORS = (0.8, 1.0)",
             "unit/compensate/test_compensation.py -k window_ends_before"),
    Mutation("safe gain: a limit cycle is no reason", "compensate/window.py",
             "good = (cycle == 0.0) & (judged <= WORSE)", "good = judged <= WORSE",
             "unit/compensate/test_compensation.py -k window_ends_before"),
    Mutation("compensation: a motion that the encoder does not resolve votes", "compensate/window.py",
             "name not in supposed and resolves(plain[name], resolution)]", "name not in supposed]",
             "unit/compensate/test_resolution.py -k does_not_vote"),
    Mutation("compensation: errors below a count count as one where an improvement is looked for",
             "compensate/window.py", "rms[k] = left[worst_on[k]]", "rms[k] = worst[worst_on[k]].judged",
             "unit/compensate/test_resolution.py -k largest_value_is_counts"),
    Mutation("tracker: the known torque is added to friction", "track/model.py",
             "coulomb(direction, F_c) - T_load - known", "coulomb(direction, F_c) - T_load + known",
             "unit/track/test_tracking_quality.py -k known_effects"),
    Mutation("tracker: the compiled twin takes the torque noise for that of the speed", "track/twin.py",
             "q = process_variance(m, s) * per_J * per_J", "q = process_variance(m, s) * per_J",
             "unit/track/test_tracking_robust.py -k through_known_effects"),
    Mutation("export: the whole of the friction, whatever the design's gain", "export/compensator.py",
             "that is fed forward\", exported_gain(design)", "that is fed forward\", 1.0",
             "unit/export/test_export.py -k agrees_with_the_terms"),
    Mutation("verify: any gain is the one that was asked for", "verify/verify.py",
             "max(policy.WRONG * expected, half)", "max(10.0 * expected, half)",
             "unit/verify/test_verify.py -k drive_is_found_to"),
    Mutation("import: an angle that wraps at its own period is unwrapped at a turn", "importers/wraps.py",
             "np.unwrap(theta, period=period)", "np.unwrap(theta)", "unit/importers"),
    Mutation("a wave of the position is confirmed by parts of the time alone", "diagnose/judging.py",
             'if refusal is None and "theta" in', 'if False and "theta" in',
             "unit/diagnose/test_one_path.py"),
    Mutation("a friction below zero contradicts the design, whatever it explains", "diagnose/contradictions.py",
             "return left - free > policy.refused_share * left", "return True",
             "unit/diagnose/test_one_direction.py"),
    Mutation("a wave of the torque is an error of the resolver", "regression/encoder_lines.py",
             "for some in rivals) > share * gain", "for some in rivals) > 1e9 * gain",
             "unit/regression/test_encoder_lines.py -k wave_of_the_torque"),
    Mutation("a step: the level of slow noise is known exactly", "evidence/events.py",
             "/ PLACES, 2, count))", "/ PLACES, 2, 10**6))",
             "unit/evidence/test_events.py -k as_rare_as_stated"),
    Mutation("of effects that contradict each other the later ones stay", "diagnose/together.py",
             "if alone.plain.chi2 < without.fit.plain.chi2", "if False",
             "unit/diagnose/test_standing.py"),
    Mutation("a command that is ahead is a delay", "diagnose/late.py",
             "    if ahead <= 0.0:", "    if ahead <= 1e9:",
             "unit/diagnose/test_slow_current_loop.py"),
    Mutation("an observer adds to a speed as a filter takes from it", "effects/structures/paths.py",
             "tau**2 * np.asarray(lfilter", "-(tau**2) * np.asarray(lfilter",
             "unit/diagnose/test_observed_speed.py -k columns"),
    Mutation("a held reference: the lines of a saw tooth as waves in the band, whole", "identify/between_samples.py",
             "size * math.sin(math.pi * (most - k) / q)", "0.5 * size * math.sin(math.pi * (most - k) / q)",
             "unit/identify/test_between_samples.py -k held_for_some"),
    Mutation("verify: a measured current does not lag", "verify/verify.py",
             '[] if channel == "i_q_ref" else', '[] if channel != "" else',
             "unit/verify/test_verify.py -k lag_of"),
    Mutation("a motion that reverses is an excitation", "frf/frf.py",
             "if instrument in MOTIONS and", "if False and",
             "unit/frf/test_frf.py -k that_reverses"),
    Mutation("a voltage in step: what all places share is a share of theirs", "regression/reference_steps.py",
             "return share - np.mean(share), ", "return share, ", "unit/regression/test_reference_steps.py"),
    Mutation("the torque of an i_d that a loop lets through is gained", "regression/reluctance.py",
             "return -np.asarray(torque_em", "return np.asarray(torque_em", "unit/regression/test_coupling.py"),
    Mutation("an axis that a load drives one way has its friction fitted", "regression/base_fit.py",
             "if record.driven:", "if False:", "unit/diagnose/test_driven.py"),
    Mutation("the same log twice is two records", "log.py",
             "if len(found) > 1 and", "if False and", "unit/test_log.py -k no_second_record"),
    Mutation("half a step of a channel counts however fast it passes", "regression/weights.py",
             "return largest * float(np.sqrt(", "return largest + 0.0 * float(np.sqrt(",
             "unit/regression/test_quantisation.py"),
    Mutation("a spring beside noise of the acceleration has a name", "diagnose/judging.py",
             "if spread < SURE * (", "if True or spread < SURE * (", "unit/diagnose/test_judging.py"),
    Mutation("a friction that bends above the highest speed is a curve", "diagnose/judging.py",
             "if bends and one.shape[bends] >", "if bends and one.shape[bends] > 1e9 *",
             "unit/diagnose/test_judging.py"),
)  # fmt: skip


def outcome(tree: Path, tests: str) -> tuple[str, float]:
    """Run tests in a copy of the tree; return what became of them, and the time in s."""
    first, *more = tests.split()
    line = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", f"tests/{first}", *more]
    environment = os.environ | {"PYTHONPATH": str(tree), "PMSM_CTRL_CACHE": str(tree / "cache")}
    start = time.perf_counter()
    done = subprocess.run(line, cwd=tree, env=environment, capture_output=True, text=True, check=False)
    names = {0: "not caught", 1: "caught", 2: "caught"}  # 2: not even importable
    return names.get(done.returncode, f"pytest ended with {done.returncode}"), time.perf_counter() - start


def main() -> None:
    """Print one row a mutation."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.mutations", description=__doc__)
    parser.add_argument("--only", default="", help="mutations whose name or file contains this")
    chosen = parser.parse_args()
    wanted = [m for m in MUTATIONS if chosen.only in m.what or chosen.only in m.file]
    missed = []
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "main"
        shutil.copytree(ROOT, tree, ignore=shutil.ignore_patterns(".*", "__pycache__", "site", "build", "*.egg-info"))
        sound = {tests: outcome(tree, tests)[0] == "not caught" for tests in {mutation.tests for mutation in wanted}}
        print("| what is broken | where | outcome | s | tests |\n|---|---|---|---|---|")
        for mutation in wanted:
            path = tree / "pmsm_ctrl" / mutation.file
            text = path.read_text(encoding="utf-8")
            if text.count(mutation.old) != 1:
                result, seconds = f"stands {text.count(mutation.old)} times in the file", 0.0
            elif not sound[mutation.tests]:
                result, seconds = "the tests fail without it", 0.0
            else:
                path.write_text(text.replace(mutation.old, mutation.new), encoding="utf-8")
                result, seconds = outcome(tree, mutation.tests)
                path.write_text(text, encoding="utf-8")
            if result != "caught":
                missed.append(mutation)
            print(f"| {mutation.what} | {mutation.file} | {result} | {seconds:.1f} | {mutation.tests} |", flush=True)
    print(f"{len(wanted) - len(missed)} of {len(wanted)} caught")
    sys.exit(1 if missed else 0)


if __name__ == "__main__":
    main()
