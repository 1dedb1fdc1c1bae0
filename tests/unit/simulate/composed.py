"""Simulations that share one compiled kernel: every effect named is composed in, those that are off at zero amplitude.

`simulate` composes only the effects that do something, and compiles every combination anew. What holds for one
combination is tested here in a kernel with more terms, whose zero amplitudes have to change nothing.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import CATALOGUE
from pmsm_ctrl.log import Log
from pmsm_ctrl.simulate import Scenario
from pmsm_ctrl.simulate.compose import load
from pmsm_ctrl.simulate.run import prepare, run_kernel

# The kernels that the tests of this room share with others; each holds the terms that its structure works with.
PLAIN = ("coulomb", "viscous")  # what nearly every test simulates
SPRUNG = ("coulomb", "viscous", "compliance")
LOOSE = ("coulomb", "viscous", "backlash")
SLIDING = ("coulomb", "viscous", "stribeck", "presliding")
DELAYED = ("coulomb", "viscous", "delay")
TERMS = tuple(effect.id for effect in CATALOGUE.values() if not effect.has_state)


def simulate_composed(
    design: Design, motion: Scenario, truth: Design | None = None, *, composed: Iterable[str] = (), seed: int = 0,
    keep_truth: bool = True,
) -> Log:  # fmt: skip
    """Simulate, with the truth in the log; effects of `composed` that the truth lacks have zero amplitude.

    Without `composed` these are all terms, in a kernel that takes five times as long as the one of dry and viscous
    friction: that one is taken where it is enough.
    """
    drive = prepare(design, motion, truth=truth)
    values, taken = {}, iter(drive.effects)
    for effect in drive.active:
        values[effect.id] = [next(taken) for _ in effect.parameters]
    composed = set(composed or (PLAIN if set(values) <= set(PLAIN) else TERMS))
    assert set(values) <= composed, "an effect is active that is not composed"
    effects = tuple(effect for effect in CATALOGUE.values() if effect.id in composed)
    for effect in effects:
        off = effect.example | dict.fromkeys(effect.amplitudes, 0.0)
        values.setdefault(effect.id, [off[parameter.symbol] for parameter in effect.parameters])
    numbers = tuple(value for effect in effects for value in values[effect.id])
    drive = replace(drive, active=effects, effects=numbers)
    compensated = drive.feedforward.effects if drive.feedforward else ()
    return drive.log(run_kernel(load(effects, compensated), drive, seed), seed, keep_truth)
