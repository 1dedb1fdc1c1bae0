"""A resonance of `frf` as a start for the diagnosis, and whether the two agree."""

from __future__ import annotations

import json
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter, lti

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.diagnose.resonance import measured, read_measured, started
from pmsm_ctrl.diagnose.result import Agreement
from pmsm_ctrl.effects.catalogue import CATALOGUE, catalogue_of
from pmsm_ctrl.effects.structures import SecondMass
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.frf import frf
from pmsm_ctrl.result import Estimate
from pmsm_ctrl.simulate import scenario, simulate

SPRING = {"J_load": 4e-5, "k": 3.0, "d": 3e-4}
ROWS = {
    "antiresonance": (43.6, "Hz", 0.01), "load_inertia": (4e-5, "kg m^2", 1e-7), "damping_ratio": (0.0137, "", 1e-4),
    "stiffness": (3.0, "N m/rad", 0.01), "damping": (3e-4, "N m s/rad", 1e-6),
}  # fmt: skip
RESPONSE = {
    "schema": "pmsm-ctrl/frf/1",
    "log": "chirp.csv",
    "estimates": {name: dict(zip(("value", "unit", "stderr"), row, strict=True)) for name, row in ROWS.items()},
    "responses": {"plant": {"frequency_hz": [1.0, 200.0]}},
}


@pytest.fixture(scope="module")
def seed(designs: Path) -> Design:
    return Design.read(designs / "seed_motor.toml")


def test_a_mass_in_closed_form() -> None:
    mass = SecondMass(**SPRING)
    assert mass.antiresonance == pytest.approx(math.sqrt(3.0 / 4e-5) / (2.0 * math.pi))
    assert mass.damping_ratio == pytest.approx(3e-4 / (2.0 * math.sqrt(3.0 * 4e-5)))


def test_springs_alone_start_from_the_measured_one(seed: Design) -> None:
    told = measured(RESPONSE)
    effects = catalogue_of(seed)
    changed = [name for name, effect in started(effects, told).items() if effect is not effects[name]]
    assert changed == [
        name for name, e in effects.items() if told.mass is not None and e.structure.values_of(told.mass)
    ]
    rigid = measured({**RESPONSE, "estimates": {}})
    assert rigid.mass is None
    assert started(effects, rigid) == effects


def test_other_files_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "frf.json"
    file.write_text(json.dumps(RESPONSE))
    assert measured(read_measured(file)) == measured(RESPONSE)
    for text in ("no json", "[1]", json.dumps({"schema": "pmsm-ctrl/diagnosis/1"})):
        file.write_text(text)
        with pytest.raises(RequestError, match="the file that frf --json writes was expected"):
            read_measured(file)
    with pytest.raises(RequestError, match="a result of frf, or its JSON, was expected"):
        measured({**RESPONSE, "responses": {}})


def test_how_far_apart_two_answers_are() -> None:
    both = Agreement(
        "a", "b", None, {"x": Estimate(3.0, "Hz", 0.3), "y": Estimate(1.0, "")}, {"x": Estimate(2.0, "Hz", 0.4)}
    )
    assert both.apart == {"x": pytest.approx(2.0)}


@pytest.mark.parametrize("hz", [20.0, 43.6, 230.0, 900.0])
def test_a_load_on_its_spring_is_followed_exactly(hz: float) -> None:
    """Against the same equation in steps a thousand times as short, below the band, in it and beyond the log's rate."""
    period, fine, zeta = 1e-3, 500, 0.02

    def motion(t: NDArray[np.float64]) -> NDArray[np.float64]:  # of a band of some 60 Hz
        return np.exp(-(((t - 0.3) / 0.02) ** 2)) * np.sin(2.0 * np.pi * 25.0 * t)

    w = 2.0 * math.pi * hz
    t, many = period * np.arange(2000), period / fine * np.arange(2000 * fine)
    load = lti([-1.0, 0.0, 0.0], [1.0, 2.0 * zeta * w, w * w]).to_discrete(period / fine, method="foh")
    expected = lfilter(load.num, load.den, motion(many))[::fine]
    effect = CATALOGUE["compliance"]
    shape = effect.structure.shape(effect, {"J_load": 1.0, "k": w * w, "d": 2.0 * zeta * w})
    log = SimpleNamespace(signals={"alpha": motion(t)}, period=period, cutoff=60.0, kept={})
    (column,) = effect.structure.columns(log, effect, shape)  # type: ignore[arg-type]
    assert column["torque"] == pytest.approx(expected, abs=2e-4 * np.max(np.abs(expected)))


@pytest.mark.parametrize(("hz", "zeta", "settled"), [(20.0, 0.05, 0.637), (20.0, 0.01, 1.0), (40.0, 0.1, 0.159)])
def test_the_swings_of_a_hard_start_are_no_prediction(hz: float, zeta: float, settled: float) -> None:
    """Four time constants of its swings, 1 / (zeta w_a), and at most a sixteenth of the log."""
    t = 1e-3 * np.arange(16_000)
    effect, w = CATALOGUE["compliance"], 2.0 * math.pi * hz
    shape = effect.structure.shape(effect, {"J_load": 1.0, "k": w * w, "d": 2.0 * zeta * w})

    def column(start: float) -> NDArray[np.float64]:
        alpha = np.cos(2.0 * np.pi * t) + start * np.exp(-t / 0.01)
        log = SimpleNamespace(signals={"alpha": alpha}, period=1e-3, cutoff=40.0, kept={})
        return effect.structure.columns(log, effect, shape)[0]["torque"]  # type: ignore[arg-type]

    first = int(np.flatnonzero(column(3.0))[0])
    assert t[first] == pytest.approx(settled, abs=2e-3)
    assert np.count_nonzero(column(0.5)[:10]) > 8, "one that is as hard as the rest of the log is followed"


def test_a_spring_that_is_not_named_is_judged_by_its_load(seed: Design) -> None:
    """A resonance beyond all bands is timing as well; the load behind it is there, and on a rigid axis it is not."""
    hz = 2.0 * math.pi * 105.0
    mass = {"J_load": 4e-5, "k": 4e-5 * hz**2, "d": 2.0 * 0.01 * 4e-5 * hz}
    rows = {"antiresonance": 105.0, "load_inertia": 4e-5, "damping_ratio": 0.01}
    rows |= {"stiffness": mass["k"], "damping": mass["d"]}
    told = {
        **RESPONSE,
        "estimates": {name: {"value": value, "unit": "", "stderr": 0.01 * value} for name, value in rows.items()},
    }
    for truth, agrees in ((seed.with_effect("compliance", mass), True), (seed, False)):
        log = simulate(seed, scenario("identification", seed, duration=15.0), truth=truth, seed=3)
        found = diagnose(seed, log, start=told, plan=False)
        assert found.resonance is not None
        assert found.resonance.effect == ""
        assert found.resonance.agrees is agrees
        assert [one.code for one in found.notices].count("frf_resonance_not_named") == 1


@pytest.mark.slow
def test_both_verbs_on_the_same_spring(seed: Design) -> None:
    """The spring is named, and its frequency and load are those of the response; an axis without one is as well."""
    truth = seed.with_effect("compliance", SPRING)
    response = frf(seed, simulate(seed, scenario("multisine", seed), truth=truth, seed=9400))
    sprung, rigid = (simulate(seed, scenario("identification", seed), truth=t, seed=9401) for t in (truth, seed))
    found = diagnose(seed, sprung, start=response, plan=False).resonance
    assert found is not None
    assert found.effect == "compliance"
    assert found.agrees is True
    assert found.diagnosed["antiresonance"].value == pytest.approx(found.frf["antiresonance"].value, rel=2e-3)
    unnamed = diagnose(seed, rigid, start=response, plan=False)
    assert "frf_resonance_not_named" in [notice.code for notice in unnamed.notices]
    assert unnamed.resonance is not None
    assert unnamed.resonance.agrees is False
    assert diagnose(truth, sprung, start=response, plan=False).resonance is None
