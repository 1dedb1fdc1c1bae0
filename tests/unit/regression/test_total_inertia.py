"""An inertia that a fit holds at its bound is none of the rotor's."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl import Design
from pmsm_ctrl.compare import compare
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.identify import identify
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.total_inertia import with_total_inertia

LOADED = "name = 'axis'\n[motor]\nJ = 1e-4\nK_t = 1.0\n[load]\nJ = 2e-3\ngear = 10.0\n"


@pytest.mark.parametrize(("found", "written"), [(1.5e-4, 1.5e-4), (2e-5, 1.2e-4), (2.0001e-5, 1.2e-4), (0.0, 1.2e-4)])
def test_the_load_is_no_rotor(found: float, written: float) -> None:
    """The load counts a hundredth behind the gear: 2e-5 kg m^2 of it leave the rotor none, and the design stays."""
    inertia = with_total_inertia(Design.from_toml(LOADED), found, 1e-6).J
    assert inertia == pytest.approx(written, rel=1e-12)


@pytest.mark.parametrize(("found", "rotor", "load"), [(2.1e-3, 1e-4, 2e-3), (1.5e-3, 1e-4, 1.4e-3), (1e-4, 1e-4, 2e-3)])
def test_the_larger_one_of_rotor_and_load_changes(found: float, rotor: float, load: float) -> None:
    """A flywheel whose sheet says a third too much, 2e-3 kg m^2: the rotor's sheet is not what is wrong."""
    design = Design.from_toml(LOADED.replace("gear = 10.0", "gear = 1.0"))
    changed = with_total_inertia(design, found, 1e-9)
    assert rotor == changed.motor.J
    assert pytest.approx(load, rel=1e-6) == changed.load.J
    geared = with_total_inertia(Design.from_toml(LOADED.replace("J = 2e-3", "J = 0.2")), found, 1e-9)
    assert rotor == geared.motor.J
    assert pytest.approx(100.0 * load, rel=1e-6) == geared.load.J


@pytest.mark.parametrize(("found", "stderr"), [(0.0, 1e-6), (1e-17, 1e-17), (-1e-5, 1e-6), (3e-9, 1e-6)])
def test_next_to_nothing_is_no_inertia(found: float, stderr: float) -> None:
    """The last one is zero once it is rounded to the digits of its standard error."""
    design = Design.from_toml("name = 'axis'\n[motor]\nJ = 1e-4\nK_t = 1.0\n")
    assert with_total_inertia(design, found, stderr) == design


def test_a_flywheel_that_is_lighter_than_its_sheet_says() -> None:
    """The total is below what the load alone would have: it was not written, and the error stayed."""
    rng = np.random.default_rng(4)
    t = np.arange(0.0, 12.0, 1e-3)
    omega = 30.0 * np.sin(2.0 * t) + 18.0 * np.sin(5.3 * t)
    alpha = 60.0 * np.cos(2.0 * t) + 95.4 * np.cos(5.3 * t)
    torque = 1.9e-3 * alpha + 0.05 * np.sign(omega) + 4e-4 * omega + 1e-3 * rng.normal(size=t.size)
    theta = -15.0 * np.cos(2.0 * t) - 18.0 / 5.3 * np.cos(5.3 * t)
    log = Log({"t": t, "theta": theta, "torque": torque})
    design = Design.from_toml(LOADED.replace("gear = 10.0", "gear = 1.0")).with_effect("coulomb", {"F_c": 0.08})
    design = design.with_effect("viscous", {"F_v": 2e-4})
    found = identify(design, log)
    for one in (found.design, diagnose(design, log, plan=False).design):
        assert one.motor.J == design.motor.J
        assert pytest.approx(1.8e-3, rel=0.005) == one.load.J
        assert compare(one, log).log.errors["torque"].relative < 0.005  # 0.03 by the sheet
    assert found.improved
