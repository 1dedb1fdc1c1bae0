"""Verbs that take long tell how far they are, and can be ended from what they tell it to."""

from __future__ import annotations

import os
import select
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl import Design, Log, add, compare, identify
from tests.effort import slow

DESIGN = """
name = "axis"
[motor]
J = 1e-4
K_t = 1.0
[[effects]]
id = "coulomb"
F_c = 0.02
[[effects]]
id = "viscous"
F_v = 1e-4
"""
VERBS: dict[str, Callable[..., Any]] = {
    "compare": compare,
    "add": lambda design, log, progress: add(design, log, "quadratic_drag", progress=progress),
    "identify": identify,
    "simulated": lambda design, log, progress: identify(design, log, method="output_error", progress=progress),
}


@pytest.fixture(scope="module")
def log() -> Log:
    t = np.arange(2000) / 250.0
    omega = 60.0 * np.sin(2.0 * np.pi * 0.4 * t) + 30.0 * np.sin(2.0 * np.pi * 0.9 * t)
    theta = np.concatenate([[0.0], np.cumsum(0.5 * (omega[1:] + omega[:-1])) / 250.0])
    torque = 1e-4 * np.gradient(omega, t) + 0.02 * np.sign(omega) + 1e-4 * omega + 4e-6 * omega * np.abs(omega)
    noise = 1e-3 * np.random.default_rng(1).standard_normal(len(t))
    return Log({"t": t, "theta": theta, "omega": omega, "i_q": torque + noise})


@pytest.mark.parametrize("verb", [slow("compare"), slow("add"), "identify", slow("simulated")])
def test_shares_rise_to_one_and_an_exception_ends_the_verb(verb: str, log: Log) -> None:
    design, shares = Design.from_toml(DESIGN), list[float]()
    VERBS[verb](design, log, progress=shares.append)
    assert shares == sorted(shares)
    assert 0.0 < shares[0] < shares[-1] == 1.0
    assert len(shares) >= (6 if verb == "simulated" else 3)
    seen: list[float] = []

    def stop(share: float) -> None:
        seen.append(share)
        if len(seen) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        VERBS[verb](design, log, progress=stop)
    assert seen == shares[:2]


@pytest.mark.skipif(sys.platform == "win32", reason="no terminal of its own")
@pytest.mark.parametrize("verb", ["compare", slow("add"), slow("identify"), "compensate"])
def test_a_terminal_shows_progress_before_anything_is_read(verb: str, tmp_path: Path) -> None:
    """The log is a pipe that nobody writes to: whatever the verb shows, it shows before its work begins."""
    (tmp_path / "axis.toml").write_text(DESIGN, encoding="utf-8")
    os.mkfifo(tmp_path / "pipe.toml")
    words = {
        "compare": ["log.csv", "-d", "pipe.toml"],
        "add": ["stribeck", "--log", "log.csv", "-d", "pipe.toml", "-o", "new.toml"],
        "identify": ["log.csv", "-d", "pipe.toml"],
        "compensate": ["axis.toml"],
    }[verb]
    (tmp_path / "log.csv").write_text("t [s],omega [rad/s],torque [N m]\n0,1,2\n", encoding="utf-8")
    ours, theirs = os.openpty()
    command = [sys.executable, "-m", "pmsm_ctrl", verb, *words]
    run = subprocess.Popen(command, cwd=tmp_path, stderr=theirs, stdout=subprocess.DEVNULL, stdin=subprocess.DEVNULL)
    try:
        shown = b""
        while verb.encode() not in shown:
            assert select.select([ours], [], [], 60.0)[0], "nothing is shown"  # s; a busy machine imports slowly
            shown += os.read(ours, 4096)
    finally:
        run.kill()
        run.wait()
        os.close(ours)
        os.close(theirs)
