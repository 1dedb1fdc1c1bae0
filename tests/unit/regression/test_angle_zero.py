"""Records whose angle has another zero, with a wave of a turn in closed form."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.identify import identify
from pmsm_ctrl.log import Log
from pmsm_ctrl.plausibility import doubts_about
from pmsm_ctrl.regression.base_fit import base_fit
from pmsm_ctrl.regression.made import Made
from pmsm_ctrl.regression.position_waves import Basis, Source, standing_out
from pmsm_ctrl.regression.timed_record import timed_record
from tests.effort import seeds, slow
from tests.slides import slide
from tests.unit.several import DESIGN, records

Waves = Mapping[float, tuple[float, float]]  # period, m, to sine and cosine part, N

PERIOD = 2.0 * np.pi / 8.0


def shifts(zeros: list[float], wave: float) -> tuple[tuple[float, float], ...]:
    logs = records([{"zero": zero} for zero in zeros], wave=wave)
    return timed_record(DESIGN, doubts_about(DESIGN, logs).log).shifts


def test_other_zeros_are_found_from_the_waves() -> None:
    zeros = [0.0, 0.2, 0.0, -0.15]
    found = shifts(zeros, 0.004)
    assert len(found) == 4
    relative = np.array([angle for angle, _ in found]) + zeros
    relative -= relative[0]
    error = (relative + 0.5 * PERIOD) % PERIOD - 0.5 * PERIOD
    assert error == pytest.approx(np.zeros(4), abs=0.01)
    assert all(0.0 < stderr < 0.01 for angle, stderr in found if angle)


@pytest.mark.parametrize(("effect", "period"), [({"ripple": 0.1}, np.pi / 3.0), ({"unbalance": 0.004}, 2.0 * np.pi)])
@pytest.mark.parametrize("zeros", [(0.0, 0.2, -0.15), slow((0.0, -0.4, 0.3))])
def test_a_ripple_and_an_unbalance_tell_the_zeros_within_their_errors(
    zeros: tuple[float, ...], effect: dict[str, float], period: float
) -> None:
    """A ripple is a share of a torque that changes its sign: as a wave of constant size it is not seen."""
    logs = records([{"zero": zero, "seconds": 8.0} for zero in zeros], **effect)
    found = timed_record(DESIGN, doubts_about(DESIGN, logs).log).shifts
    relative = np.array([angle for angle, _ in found]) + zeros
    error = (relative - relative[0] + 0.5 * period) % period - 0.5 * period
    stderr = max(stderr for _, stderr in found)
    assert stderr < 0.0025 * period  # ten times as large with the wave in the noise
    assert error == pytest.approx(np.zeros(3), abs=4.0 * stderr)


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_two_periods_along_a_line_give_one_zero(seed: int) -> None:
    """They repeat together after five of the one and two of the other, not after the longer one."""
    waves, zeros = {0.024: (4.0, 0.0), 0.06: (2.0, 1.0)}, np.array([0.0, 0.009, 1.3])
    one = slide("moves", seed, waves)
    logs = [one.log, *(slide("sines", 100 * k + seed, waves, one, zeros[k]).log for k in (1, 2))]
    found = timed_record(one.design, doubts_about(one.design, logs).log).shifts
    relative = np.array([shift for shift, _ in found]) + zeros
    error = (relative - relative[0] + 0.06) % 0.12 - 0.06
    stderr = max(stderr for _, stderr in found)
    assert stderr < 1e-4
    assert error == pytest.approx(np.zeros(3), abs=5.0 * stderr)


@pytest.mark.parametrize("wave", [0.0, 0.004])
def test_one_zero_is_left_alone(wave: float) -> None:
    assert shifts([0.0, 0.0, 0.0], wave) == ()


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
@pytest.mark.parametrize("waves", [{0.024: (2.0, 0.0)}, slow({0.024: (3.0, 0.0), 0.012: (0.8, 1.3)})])
def test_other_zeros_along_a_line_are_found_from_what_repeats(waves: Waves, seed: int) -> None:
    one, zeros = slide("moves", seed, waves), np.array([0.0, 0.009, 0.0])
    logs = [one.log, *(slide("sines", 100 * k + seed, waves, one, zeros[k]).log for k in (1, 2))]
    found = timed_record(one.design, doubts_about(one.design, logs).log).shifts
    relative = np.array([shift for shift, _ in found]) + zeros
    error = (relative - relative[0] + 0.012) % 0.024 - 0.012
    assert error == pytest.approx(np.zeros(3), abs=4.0 * max(stderr for _, stderr in found))
    assert all(0.0 < stderr < 5e-4 for shift, stderr in found if shift)


@pytest.mark.parametrize("waves", [{}, {0.024: (2.0, 0.0)}])
@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_one_zero_along_a_line_is_left_alone(waves: Waves, seed: int) -> None:
    one = slide("moves", seed, waves)
    logs = [one.log, *(slide("sines", 100 * k + seed, waves, one).log for k in (1, 2))]
    assert timed_record(one.design, doubts_about(one.design, logs).log).shifts == ()


@pytest.mark.parametrize("place", [slow(0), 1, slow(2)])
def test_a_record_that_stands_still_tells_no_zero(place: int) -> None:
    """Of a linear axis it has no sample of a motion, and a place all the same."""
    waves = {0.024: (3.0, 0.0)}
    one = slide("moves", 1, waves)
    t = np.arange(3000) / 1000.0
    noise = np.random.default_rng(1).normal(size=t.size)
    logs = [one.log, slide("sines", 101, waves, one, 0.009).log]
    logs.insert(place, Log({"t": t, "theta": np.full(t.size, 0.1), "torque": noise}, motion="linear"))
    shifts = [shift for shift, _ in timed_record(one.design, doubts_about(one.design, logs).log).shifts]
    assert shifts.pop(place) == 0.0
    assert abs(shifts[1] - shifts[0]) == pytest.approx(0.009, abs=2e-4)
    assert identify(one.design, logs).estimates["J"].value == pytest.approx(one.true["J"], rel=0.01)
    assert len(diagnose(one.design, logs, candidates=["detent_force"], plan=False).records) == 3


def test_a_line_without_a_peak_in_its_spectrum_has_no_waves() -> None:
    one = slide("moves", 1, {})
    record = timed_record(one.design, one.log)
    source = Source.of(record, base_fit(one.design, record))
    assert standing_out([source], Basis(np.zeros(0), np.zeros(0, dtype=bool)), 1) is None


@pytest.mark.parametrize("speed_alone", [False, True])
def test_a_zero_does_not_hang_on_the_band_nor_on_the_channel(speed_alone: bool) -> None:
    """Records of a speed alone each begin at an angle of zero: where they began in truth is told by their waves."""
    logs = records([{"zero": zero} for zero in (0.0, 0.2, -0.15)], wave=0.004)
    if speed_alone:
        logs = [
            Log({name: log[name] for name in log if name != "theta"} | {"omega": np.gradient(log["theta"], log.t)})
            for log in logs
        ]
    joined = doubts_about(DESIGN, logs).log
    made = Made.kept(joined)
    whole = timed_record(DESIGN, joined, made)
    assert any(angle for angle, _ in whole.shifts)
    assert timed_record(DESIGN, joined, made, 0.5 * whole.cutoff).shifts == whole.shifts
