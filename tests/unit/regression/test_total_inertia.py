"""An inertia that a fit holds at its bound is none of the rotor's."""

from __future__ import annotations

import pytest

from pmsm_ctrl import Design
from pmsm_ctrl.regression.total_inertia import with_total_inertia

LOADED = "name = 'axis'\n[motor]\nJ = 1e-4\nK_t = 1.0\n[load]\nJ = 2e-3\ngear = 10.0\n"


@pytest.mark.parametrize(("found", "written"), [(1.5e-4, 1.5e-4), (2e-5, 1.2e-4), (2.0001e-5, 1.2e-4), (0.0, 1.2e-4)])
def test_the_load_is_no_rotor(found: float, written: float) -> None:
    """The load counts a hundredth behind the gear: 2e-5 kg m^2 of it leave the rotor none, and the design stays."""
    inertia = with_total_inertia(Design.from_toml(LOADED), found, 1e-6).J
    assert inertia == pytest.approx(written, rel=1e-12)


@pytest.mark.parametrize(("found", "stderr"), [(0.0, 1e-6), (1e-17, 1e-17), (-1e-5, 1e-6), (3e-9, 1e-6)])
def test_next_to_nothing_is_no_inertia(found: float, stderr: float) -> None:
    """The last one is zero once it is rounded to the digits of its standard error."""
    design = Design.from_toml("name = 'axis'\n[motor]\nJ = 1e-4\nK_t = 1.0\n")
    assert with_total_inertia(design, found, stderr) == design
