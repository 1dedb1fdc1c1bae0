"""A batch gives what single runs give, in order, whatever the number of threads."""

import threading
import time

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import DesignError, RequestError
from pmsm_ctrl.simulate import scenario, simulate
from pmsm_ctrl.simulate.batch import simulate_batch


@pytest.fixture(scope="module")
def seed_motor(project_root):
    return Design.read(project_root / "designs/seed_motor.toml")


@pytest.fixture(scope="module")
def motion():
    return scenario("triangle", period=0.4, cycles=1)


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_a_batch_is_its_single_runs(seed_motor, motion, workers):
    designs = [seed_motor.with_parameters(J=9e-5 * factor) for factor in (0.8, 1.0, 1.2, 1.4)]
    F_v = seed_motor.parameters("viscous")  # set again, so that the order of the effects and the kernel stay the same
    truths = [
        seed_motor.with_effect("coulomb", {"F_c": F_c}).with_effect("viscous", F_v) for F_c in (0.01, 0.02, 0.03, 0.0)
    ]
    logs = simulate_batch(designs, motion, truths=truths, seed=7, workers=workers)
    for k, log in enumerate(logs):
        alone = simulate(designs[k], motion, truth=truths[k], seed=7 + k)
        assert all(np.array_equal(log[name], alone[name]) for name in alone)


def test_keep_replaces_the_log(seed_motor, motion):
    seen = []
    peaks = simulate_batch([seed_motor] * 3, motion, keep=lambda log: float(log["omega"].max()), progress=seen.append)
    assert all(peak == pytest.approx(20.0, abs=1.5) for peak in peaks)
    assert seen == [pytest.approx(share) for share in (1 / 3, 2 / 3, 1.0)]


def test_the_kernel_lets_other_threads_run(seed_motor):
    """While a long run is in the kernel, a thread that sleeps half a millisecond at a time gets its turns."""
    design = seed_motor.replace(sensor={"log_divider": 1600})
    simulate(design, scenario("hold", duration=0.2))
    turns = 0
    finished = threading.Event()

    def count():
        nonlocal turns
        while not finished.is_set():
            time.sleep(0.0005)
            turns += 1

    watcher = threading.Thread(target=count)
    watcher.start()
    simulate(design, scenario("hold", duration=100.0))
    finished.set()
    watcher.join()
    assert turns > 10  # the interpreter's lock held through all seven chunks would leave at most one turn each


def test_wrong_batches_are_refused(seed_motor, motion):
    assert simulate_batch([], motion) == []
    with pytest.raises(RequestError, match="2 designs but 1 truths"):
        simulate_batch([seed_motor] * 2, motion, truths=[seed_motor])
    with pytest.raises(RequestError, match="workers: found 0"):
        simulate_batch([seed_motor], motion, workers=0)
    no_loops = seed_motor.model_copy(update={"loops": None})
    with pytest.raises(DesignError, match=r"^drive 2 of 3: .*loops: missing"):
        simulate_batch([seed_motor, seed_motor, no_loops], motion)
