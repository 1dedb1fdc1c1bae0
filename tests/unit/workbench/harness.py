"""A workbench whose tasks run in a thread, and a small drive with its log."""

from __future__ import annotations

import time
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl import Log

TESTCLIENT = pytest.importorskip("starlette.testclient", reason="STARLETTE ABSENT: pip install 'pmsm-ctrl[dev]'")
pytest.importorskip("httpx", reason="HTTPX ABSENT: pip install 'pmsm-ctrl[dev]'")


TOKEN = "token-of-the-tests"
PORT = 8720
PATIENCE = 300.0  # s; without a cache the first fit compiles its code
DESIGN = """
name = "<script>alert(1)</script>"
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


def moved(seed: int, drag: float = 4e-6) -> Log:
    """A log of 12 s at 250 Hz: inertia, dry and viscous friction, and a drag that the design does not know."""
    rng = np.random.default_rng(seed)
    t = np.arange(3000) / 250.0
    omega = 60.0 * np.sin(2.0 * np.pi * 0.21 * t) + 30.0 * np.sin(2.0 * np.pi * 0.55 * t + seed)
    theta = np.concatenate([[0.0], np.cumsum(0.5 * (omega[1:] + omega[:-1])) / 250.0])
    alpha = np.gradient(omega, t)
    torque = 1e-4 * alpha + 0.02 * np.tanh(omega / 0.05) + 1e-4 * omega + drag * omega * np.abs(omega)
    return Log({"t": t, "theta": theta, "omega": omega, "i_q": torque + 1e-3 * rng.standard_normal(len(t))})


class Page:
    """One session, as a page sees it."""

    def __init__(self, client: Any, base: str) -> None:
        self.client = client
        self.base = base

    def get(self, path: str, **options: Any) -> Any:
        return self.client.get(f"{self.base}/{path}", **options)

    def post(self, path: str, body: Any) -> Any:
        return self.client.post(f"{self.base}/{path}", json=body)

    def put(self, name: str, body: bytes) -> Any:
        return self.client.put(f"{self.base}/logs", params={"name": name}, content=body)

    def idle(self) -> dict[str, Any]:
        """Wait until nothing is computed any more, and return the state."""
        begin = time.monotonic()
        while time.monotonic() - begin < PATIENCE:
            state: dict[str, Any] = self.get("state").json()
            if state["job"] is None:
                return state
            time.sleep(0.02)
        raise AssertionError(f"still busy: {state['job']}")


class Bench:
    """A server of the tests."""

    def __init__(self, folder: Path, limit: int = 8 << 20, make: Any = None, code: bool = False) -> None:
        self.folder = folder
        from pmsm_ctrl.workbench.desk import Desk
        from pmsm_ctrl.workbench.server import Settings, guarded
        from pmsm_ctrl.workbench.session import Sessions
        from pmsm_ctrl.workbench.workers import Workers

        self.desk = Desk(Sessions(folder), Workers(make or thread), code=code)
        self.app = guarded(self.desk, Settings(folder=folder, token=TOKEN, upload=limit), PORT)

    def client(self, **options: Any) -> Any:
        return TESTCLIENT.TestClient(self.app, base_url=f"http://127.0.0.1:{PORT}", **options)


def thread() -> Executor:
    return ThreadPoolExecutor(1)
