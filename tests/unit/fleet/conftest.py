"""A folder of short logs of two axes, written once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

SEED = Path(__file__).resolve().parents[3] / "designs" / "seed_motor.toml"


def write_log(path: Path, F_c: float, seed: int) -> None:
    """Write 6 s of a multisine on the reference motor with this friction."""
    t = np.arange(0, 6, 1e-3)
    omega = 80 * np.sin(np.pi * t) + 40 * np.sin(2.6 * np.pi * t + 1)
    alpha = 80 * np.pi * np.cos(np.pi * t) + 104 * np.pi * np.cos(2.6 * np.pi * t + 1)
    torque = 9e-5 * alpha + F_c * np.sign(omega) + 1.68e-4 * omega + np.random.default_rng(seed).normal(0, 1e-3, t.size)
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(path, np.column_stack((t, omega, torque)), fmt="%.9g", delimiter=",",
               header="t [s],omega [rad/s],torque [N m]", comments="")  # fmt: skip


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
