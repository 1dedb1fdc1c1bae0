"""The part of a torque command that the current loop spends on the back-emf, against the loop in closed form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import control
import numpy as np
import pytest

from pmsm_ctrl import Design, simulate
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import make_record
from pmsm_ctrl.regression.base_fit import base_fit
from pmsm_ctrl.regression.drive_timing import CURRENT_LOOP, emf_left
from pmsm_ctrl.regression.filters import derivative, low_pass
from pmsm_ctrl.regression.model import base_groups
from pmsm_ctrl.regression.modelled import with_modelled_torque
from pmsm_ctrl.regression.timed_record import timed_record, with_friction
from tests.benchmarks.worlds.hidden import simulate_world
from tests.benchmarks.worlds.world import draw
from tests.effort import seeds, slow

RATE, BAND = 4000.0, 40.0


def motion(t: np.ndarray) -> np.ndarray:
    """Speed under a torque that steps every 0.2 s, rad/s."""
    return 40.0 * (2.0 * np.abs(2.0 * ((t / 0.4 + 0.25) % 1.0) - 1.0) - 1.0)


def unlike(target: np.ndarray, columns: Sequence[np.ndarray]) -> float:
    """Return the share of a signal, in the band, that columns do not explain."""
    inner = slice(2000, -2000)
    rows = np.array([low_pass(c, RATE, BAND)[inner] for c in (target, *columns)])
    rows /= np.linalg.norm(rows, axis=1)[:, None]
    found, *_ = np.linalg.lstsq(rows[1:].T, rows[0], rcond=None)
    return float(np.linalg.norm(rows[0] - found @ rows[1:]))


@pytest.fixture(scope="module")
def design(project_root: Path) -> Design:
    return Design.read(project_root / "designs" / "seed_motor.toml")


@pytest.mark.parametrize("tau", [slow(0.5e-3), slow(1e-3), 2e-3, slow(4e-3), 8e-3])
@pytest.mark.parametrize("loop", [250.0, slow(900.0)])
def test_a_filtered_speed_leaves_what_the_two_columns_span(design: Design, loop: float, tau: float) -> None:
    """L di/dt + R i = u - p psi omega, u = w (L + R / s) (i_ref - i) + p psi omega / (tau s + 1), by python-control."""
    m, w, s = design.motor, 2.0 * np.pi * loop, control.tf("s")
    assert None not in (m.R, m.L_q, m.psi_f, m.p)
    missed = 1.0 - 1.0 / (tau * s + 1.0)
    error = m.p * m.psi_f * missed * s / ((m.L_q * s + m.R) * (s + w))
    t = np.arange(round(4.0 * RATE)) / RATE
    omega = motion(t)
    left = design.K_t_assumed * np.asarray(control.forced_response(error, t, omega).outputs)
    alpha = derivative(omega, 1.0 / RATE)
    columns = emf_left(design, alpha, 1.0 / RATE)
    assert columns is not None
    # beside an inertia and a lateness, as in any fit
    beside = [alpha, derivative(alpha, 1.0 / RATE)]
    both, late = (unlike(left, [*some, *beside]) for some in (columns, columns[:1]))
    assert both < (0.03 if tau < 5e-3 else 0.09)
    assert late > 2.0 * both


def test_the_columns_are_of_the_band_where_the_torque_is_modelled(design: Design) -> None:
    # what follows from the modelled torque is filtered already, and what follows from the measured motion is not
    record = replace(make_record(design, simulate(design, "identification", seed=1)), commanded=True)
    columns = emf_left(design, record.signals["alpha"], record.period)
    assert columns is not None
    modelled = with_modelled_torque(record, record.target[0])
    model = base_groups(design, modelled)[0]
    for name, column in zip(("tau_emf", "tau_emf_filtered"), columns, strict=True):
        assert model.matrix[0][:, model.names.index(name)] == pytest.approx(record.shaped(column), abs=1e-9)


@pytest.mark.parametrize("motion", ["identification", "sweep"])
@pytest.mark.parametrize("seed", seeds(1, 2))
def test_what_is_measured_is_no_command(design: Design, motion: str, seed: int) -> None:
    log = simulate(design, motion, seed=seed)
    kept = {name: log[name] for name in ("t", "theta", "omega")}
    late = np.interp(log.t - 3e-3, log.t, log["i_q"])
    for values in (log["i_q"], late):
        assert not timed_record(design, Log({**kept, "i_q": values})).commanded


@pytest.mark.parametrize("seed", seeds(4800586, 5200508))
def test_a_command_shows_itself(seed: int) -> None:
    """Of a speed filter of 6.4 and 1.0 ms; both were a gap to the diagnosis, and the second had an emf of a tenth."""
    world = draw(seed)
    record = timed_record(world.design, simulate_world(world))
    assert record.commanded
    found = base_fit(with_friction(world.design), record)
    w = world.loops[0] / world.motor[2]  # bandwidth of the current loop, rad/s
    late = world.loops[5] + world.divider / world.f_control  # its filter, a difference quotient, and a hold
    total = found.level("tau_emf") + found.level("tau_emf_filtered")
    assert total == pytest.approx(late / (w * CURRENT_LOOP), rel=0.25)


@pytest.mark.parametrize("seed", seeds(10000339))
def test_a_command_shows_itself_where_the_axis_hardly_turns_back(seed: int) -> None:
    """Of a speed filter of 6 ms in a staircase: the loop and the compensation are told apart by one reversal.

    The torque was 2.2 ms early to the fit and the filter 15 ms long, and it was no command.
    """
    world = draw(seed)
    record = timed_record(world.design, simulate_world(world))
    assert record.commanded
    assert base_fit(with_friction(world.design), record).level("J") == pytest.approx(world.motor[5], rel=0.005)
