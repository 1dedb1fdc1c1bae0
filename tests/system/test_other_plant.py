"""The diagnosis on logs of a second simulator that shares nothing with the package."""

from __future__ import annotations

import pytest

from pmsm_ctrl.diagnose import diagnose
from tests.benchmarks.other_plant import other_log, right


@pytest.mark.parametrize(("effect", "own_angle"), [("", False), (", logged angle alone", True)])
def test_eccentricity_of_the_encoder_that_commutates_and_of_another(effect: str, own_angle: bool) -> None:
    found = diagnose(*other_log("encoder_eccentricity" + effect, 40))
    assert right("encoder_eccentricity", found)
    assert any("commutates by another" in text for text in found.warnings) is own_angle


@pytest.mark.parametrize("seed", [140, 141, 142])
def test_nothing_is_named_where_nothing_is_missing(seed: int) -> None:
    assert diagnose(*other_log("none", seed)).verdict == "consistent"
