"""When values by the reference take the place of those by least squares."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl.regression import lateness
from pmsm_ctrl.regression.drive_timing import LATENESS, SPREAD
from pmsm_ctrl.regression.instruments import ReferenceEstimates
from pmsm_ctrl.regression.model import Model
from pmsm_ctrl.regression.two_stage import HeldResponse

# How far the delay may lie from zero, s; least squares finds a delay of -1.5 ms, as in world 440248.
SAMPLING, EARLY = 3e-3, 4e-3
FOUND = {"J": (1e-5, 1e-8), LATENESS: (-1.5e-3, 5e-5), SPREAD: (5e-6, 1e-6)}


def model_after(late: tuple[float, float]) -> tuple[Model, Model]:
    """Return the model before and after the delay was bounded, with this delay by the reference, s."""
    names = tuple(FOUND)
    free = Model((), names, np.zeros(3), np.full(3, np.inf), np.zeros((1, 0, 3)))
    values, stderr = (np.array([pair[k] for pair in FOUND.values()]) for k in (0, 1))
    fit: Any = SimpleNamespace(values=values, stderr=stderr)
    record: Any = SimpleNamespace(
        sampling=SAMPLING, early=EARLY, sampling_stated=False, timing=SimpleNamespace(late=0.0)
    )
    none = HeldResponse(np.zeros(0), np.zeros(0))
    said = ReferenceEstimates((1e-5, 1e-7), late, (-1e-6, 1e-6), 0.002, dict.fromkeys(names, none))
    return free, lateness._with_sampling_held(record, free, fit, said)


def test_a_reference_that_knows_the_delay_takes_the_place_of_a_biased_one() -> None:
    _, model = model_after((1e-3, 1e-4))
    assert model.nominal[1] == pytest.approx(1e-3)
    assert model.nominal[2] == pytest.approx(-1e-6)


def test_a_reference_that_does_not_determine_the_delay_shows_no_bias() -> None:
    """A quadratic drag made the reference answer 12 +- 4.5 ms: the delay was then held at 0, and nothing was named."""
    free, model = model_after((12e-3, 4.5e-3))
    assert (model.nominal is free.nominal, model.sigma is free.sigma, model.doubt) == (True, True, {})
    # but of the two one is wrong: the error allows for what they differ by, beyond that of the reference
    assert model.bias == {1: pytest.approx(np.sqrt(13.5e-3**2 - 4.5e-3**2))}
