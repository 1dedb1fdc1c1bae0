"""A folder of short logs of two axes, written once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.fleet import Manifest, read_manifest

SEED = Path(__file__).resolve().parents[3] / "designs" / "seed_motor.toml"


def write_log(path: Path, F_c: float, seed: int) -> None:
    """Write 6 s at 500 Hz of a multisine on the reference motor with this friction."""
    t = np.arange(0, 6, 2e-3)
    omega = 80 * np.sin(np.pi * t) + 40 * np.sin(2.6 * np.pi * t + 1)
    alpha = 80 * np.pi * np.cos(np.pi * t) + 104 * np.pi * np.cos(2.6 * np.pi * t + 1)
    torque = 9e-5 * alpha + F_c * np.sign(omega) + 1.68e-4 * omega + np.random.default_rng(seed).normal(0, 1e-3, t.size)
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(path, np.column_stack((t, omega, torque)), fmt="%.9g", delimiter=",",
               header="t [s],omega [rad/s],torque [N m]", comments="")  # fmt: skip


OWN_EFFECT = """
import math

from pmsm_ctrl.effects import Effect, Parameter, kernel


@kernel
def drag(omega, direction, k_seal):
    return k_seal * math.sqrt(abs(omega)) * direction


seal = Effect(
    id="seal_drag", title="Wiper seal", equation="k sqrt(w)", source="a user", enters="torque",
    parameters=(Parameter("k_seal", "N m", 0.0, 0.0, math.inf, "drag at 1 rad/s", linear=True),),
    term=drag, needs="several speeds",
)
"""


@pytest.fixture
def own(tmp_path: Path, two_axes: Path) -> Manifest:
    """Return the manifest of two axes whose design names an effect of a user's file."""
    (tmp_path / "seal.py").write_text(OWN_EFFECT, encoding="utf-8")
    design = SEED.read_text(encoding="utf-8") + '\n[[effects]]\nid = "seal_drag"\nk_seal = 0.0\n'
    (tmp_path / "own.toml").write_text(design, encoding="utf-8")
    return replace(
        read_manifest(two_axes / "run.toml"), design=str(tmp_path / "own.toml"), effects=str(tmp_path / "seal.py"),
        results=str(tmp_path / "results"),
    )  # fmt: skip


@pytest.fixture(scope="session")
def two_axes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two axes, two days each, F_c 0.020 and 0.030 N m, one file empty; only `identify` is asked for."""
    folder = tmp_path_factory.mktemp("fleet")
    for axis, F_c in (("a1", 0.020), ("a2", 0.030)):
        for day in (1, 2):
            write_log(folder / "logs" / axis / f"2026-03-0{day}.csv", F_c, day)
    (folder / "logs" / "a2" / "2026-03-03.csv").write_text("", encoding="utf-8")
    (folder / "run.toml").write_text(
        f'logs = "logs/*/*.csv"\npath = "{{axis}}/{{time:%Y-%m-%d}}.csv"\ndesign = "{SEED}"\n'
        "compare = false\ndiagnose = false\n",
        encoding="utf-8",
    )
    return folder
