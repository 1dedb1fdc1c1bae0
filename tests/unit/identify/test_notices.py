"""Why a parameter gets no number: every cause has its words and its code."""

from __future__ import annotations

import pytest

from pmsm_ctrl.identify.notices import not_identifiable
from pmsm_ctrl.regression.least_squares import Cause, Combination, Unidentifiable

DETAIL = {
    Cause.NOT_EXCITED: {},
    Cause.COLLINEAR: {"partners": ("F_v", "T_0")},
    Cause.UNCERTAIN: {"half_width": 0.31, "limit": 0.1, "unit": "N m"},
    Cause.NO_ACCELERATION: {"torque": 1e-3, "residual": 4e-3, "unit": "N m"},
    Cause.EFFECT_ABSENT: {"sizes": ("dF_s",)},
    Cause.IMPOSSIBLE: {"value": -9e-5, "stderr": 1e-6, "unit": "kg m^2"},
}


@pytest.mark.parametrize("cause", Cause)
def test_every_cause_has_words_and_a_code(cause: Cause) -> None:
    notice = not_identifiable(Unidentifiable(cause, "coulomb", DETAIL[cause]), "motion in both directions")
    assert notice.code == cause.value
    for value in DETAIL[cause].values():
        for part in value if isinstance(value, tuple) else (value,):
            assert (part if isinstance(part, str) else f"{part:.2g}") in notice.text
    # another motion does not help where noise is the cause, or the effect is off
    remedied = cause in (Cause.NOT_EXCITED, Cause.COLLINEAR, Cause.NO_ACCELERATION)
    assert ("it needs motion in both directions" in notice.text) == remedied


def test_what_is_known_is_the_weighted_sum() -> None:
    known = Combination({"F_c": 1.0, "F_v": 50.0, "T_0": -1.0}, 0.02965, 4.3e-5, "N m")
    lost = Unidentifiable(Cause.COLLINEAR, "coulomb", DETAIL[Cause.COLLINEAR], known, held=True)
    text = not_identifiable(lost, "").text
    assert text == (
        "not separable from F_v, T_0 on this motion; identifiable: F_c + 50 F_v - T_0 = 0.02965 +- 4.3e-05 N m; "
        "held at the design's value"
    )
