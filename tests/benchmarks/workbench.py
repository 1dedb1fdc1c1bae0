r"""How fast the workbench answers: a server of its own, asked over HTTP as its page asks.

    python -m tests.benchmarks.workbench                  a zoom, a rung, an upload; 2 minutes
    python -m tests.benchmarks.workbench --only zoom      200 zooms into 10 million samples: median, 99 %, slowest

The page asks for a stretch of three channels at 1000 pixel columns; what it asks of a model (both sides of a balance,
residual and speed; the residual over the angle) is computed without a server, on curves of the same length. `rung` is
an effect added to a log of 30 s at 1 kHz, with a second one held out, from the request until the new table of errors is
there; the later ones of the same name are known already. `upload` is a table of text of 200 MB; memory is that of the
server's process and of its session's. Times are of the clock: on a machine that does other work they are upper bounds.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from http.client import HTTPConnection
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import quote, urlsplit

import numpy as np

from pmsm_ctrl import Design, simulate
from pmsm_ctrl.workbench.curves import write_curves
from pmsm_ctrl.workbench.views import VIEWS

SAMPLES, CHANNELS, BINS = 10_000_000, "theta,omega,i_q", 1000
HIDDEN = {
    "stribeck": {"dF_s": 0.008, "w_s": 8.0, "delta": 2.0},
    "cogging": {"a_s": 0.004, "a_c": 0.0, "order": 24.0},
}


class Client:
    """One session of a server, over one connection that is kept."""

    def __init__(self, address: str, process: int) -> None:
        self.process = process
        url = urlsplit(address)
        assert url.hostname is not None
        self._connection = HTTPConnection(url.hostname, url.port, timeout=600)
        self._connection.request("GET", url.path)
        answer = self._connection.getresponse()
        answer.read()
        self.base = f"{url.path}{answer.headers['location']}"

    def close(self) -> None:
        """End the connection."""
        self._connection.close()

    def ask(self, method: str, path: str, body: Any = None) -> bytes:
        """Return the answer to one request."""
        given = json.dumps(body).encode() if isinstance(body, dict) else body
        headers = {"content-length": str(os.fstat(body.fileno()).st_size)} if hasattr(body, "fileno") else {}
        self._connection.request(method, self.base + path, given, headers)
        answer = self._connection.getresponse()
        text = answer.read()
        if answer.status >= 400:
            raise SystemExit(f"{method} {path}: {answer.status} {text.decode()}")
        return text

    def idle(self) -> dict[str, Any]:
        """Wait until nothing is computed any more, as the page does, and return the state."""
        state: dict[str, Any] = json.loads(self.ask("GET", "state"))
        while state["job"] is not None:
            state = json.loads(self.ask("GET", f"state?since={state['revision']}"))
        if state["message"]:
            raise SystemExit(state["message"])
        return state

    def upload(self, path: Path) -> dict[str, Any]:
        """Upload a file, and wait until it is read."""
        with open(path, "rb") as file:
            self.ask("PUT", f"logs?name={quote(path.name)}", file)
        state = self.idle()
        error = state["logs"][-1]["info"]["error"]
        if error:
            raise SystemExit(error)
        return state

    def memory(self, kind: str = "VmHWM") -> tuple[float, float]:
        """Return the memory, MB, of the server and of the largest of its processes; see `memory_of`."""
        found = subprocess.run(["pgrep", "-P", str(self.process)], capture_output=True, text=True, check=False)
        children = [memory_of(int(one), kind) for one in found.stdout.split()]
        return memory_of(self.process, kind), max(children, default=0.0)


def memory_of(process: int, kind: str = "VmHWM") -> float:
    """Return the resident memory of a process, MB: the largest so far, or as ``VmRSS`` the present one."""
    lines = Path(f"/proc/{process}/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) / 1024.0 for line in lines if line.startswith(kind))


@contextmanager
def served(folder: Path) -> Iterator[Callable[[], Client]]:
    """Run a server; what is yielded begins a session."""
    command = [sys.executable, "-m", "pmsm_ctrl", "workbench", "--no-browser", "--folder", str(folder / "sessions")]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    clients: list[Client] = []

    def session() -> Client:
        clients.append(Client(address, process.pid))
        return clients[-1]

    try:
        address = process.stdout.readline().split()[1]
        yield session
    finally:
        for one in clients:
            one.close()
        process.terminate()
        process.wait(30)
        process.stdout.close()


def columns(samples: int) -> dict[str, np.ndarray]:
    """Return a motion in single precision but for time."""
    t = np.arange(samples) / 4000.0
    theta = (50.0 * np.sin(0.7 * t)).astype(np.float32)
    omega = (35.0 * np.cos(0.7 * t)).astype(np.float32)
    noise = np.random.default_rng(1).normal(0.0, 1e-3, samples).astype(np.float32)
    return {"t": t, "theta": theta, "omega": omega, "i_q": 0.02 * np.sign(omega) + noise}


def written(path: Path, megabytes: float) -> Path:
    """Write a table of text of a size."""
    import pyarrow as pa
    import pyarrow.csv

    table = {name: pa.array(values) for name, values in columns(int(megabytes * 1e6 / 42.0)).items()}
    names = {"t": "t [s]", "theta": "theta [rad]", "omega": "omega [rad/s]", "i_q": "i_q [A]"}
    pyarrow.csv.write_csv(pa.table({names[name]: values for name, values in table.items()}), path)
    return path


def zoom(client: Client, folder: Path) -> None:
    """Stretches of all widths."""
    np.savez(folder / "long.npz", **columns(SAMPLES))
    client.ask("POST", "design", {"example": "seed_motor"})
    state = client.upload(folder / "long.npz")
    log, stop = state["logs"][0]["id"], state["logs"][0]["info"]["stop"]
    asked = f"view/log?log={log}&channels={CHANNELS}&bins={BINS}"
    view_of_log = lambda start, end: client.ask("GET", f"{asked}&start={start}&stop={end}")  # noqa: E731
    zooms("log, over HTTP", stop, view_of_log, client.process)
    session: Any = SimpleNamespace(folder=folder, state={"model": {"records": [model_curves(folder)]}})
    for what, off in (("model", ""), ("model", "part"), ("scatter", "")):
        given = {"bins": str(BINS), "over": "angle", "off": off}
        view = VIEWS[what]
        zooms(
            f"{what}{' without an effect' if off else ''}",
            stop,
            lambda start, end, view=view, given=given: view(session, given | {"start": str(start), "stop": str(end)}),
            os.getpid(),
        )


def zooms(name: str, stop: float, view: Callable[[float, float], Any], process: int) -> None:
    """Time 200 views of all widths, the whole record among them; of the slowest say what the process did meanwhile."""
    rng, took = np.random.default_rng(2), []
    for number in range(200):
        width = stop * (1.0 if number % 20 == 0 else 10.0 ** rng.uniform(-5.0, 0.0))
        start = rng.uniform(0.0, stop - width)
        before, began = scheduled(process), time.perf_counter()
        view(start, start + width)
        ms = 1e3 * (time.perf_counter() - began)
        ran, waited = (after - one for after, one in zip(scheduled(process), before, strict=True))
        took.append((ms, number, width, ran, waited))
    times = np.array([one[0] for one in took])
    ms, number, width, ran, waited = max(took)
    print(
        f"zoom, {SAMPLES:.0e} samples, {name}: median {np.median(times):.1f} ms, 99 % {np.quantile(times, 0.99):.1f} "
        f"ms, slowest {ms:.1f} ms (number {number}, {4000.0 * width:.0f} samples wide; computed {ran:.1f} ms, waited "
        f"{waited:.1f} ms for a processor)"
    )


def scheduled(process: int) -> tuple[float, float]:
    """Return how long the threads of a process have run, and how long they were ready to run but did not, ms."""
    ran, waited = 0.0, 0.0
    for path in Path(f"/proc/{process}/task").glob("*/schedstat"):
        with suppress(OSError):
            words = path.read_text(encoding="ascii").split()
            ran, waited = ran + int(words[0]) / 1e6, waited + int(words[1]) / 1e6
    return ran, waited


def model_curves(folder: Path) -> dict[str, Any]:
    """Write the curves of a model, and return what the state of a session says of them."""
    signals = columns(SAMPLES)
    force = signals["i_q"]
    write_curves(folder / "model", {
        "t": signals["t"], "used": np.ones(SAMPLES), "torque:measured": force, "torque:predicted": 0.9 * force,
        "torque:residual": 0.1 * force,
        "torque:part:part": 0.1 * force, "over:speed": signals["omega"], "over:angle": signals["theta"],
    })  # fmt: skip
    balance = {"name": "torque", "parts": ["part"]}
    return {"curves": "model", "coordinates": ["speed", "angle"], "balances": [balance]}


def rung(client: Client, folder: Path) -> None:
    """The base parameters, two effects added, and the same again, taken back each time."""
    design = Design.example("seed_motor")
    truth = design
    for effect, parameters in HIDDEN.items():
        truth = truth.with_effect(effect, parameters)
    client.ask("POST", "design", {"example": "seed_motor"})
    for seed, name in ((1, "fitted.csv"), (2, "held_out.csv")):
        client.upload(simulate(design, "identification", truth=truth, seed=seed).write_csv(folder / name))
    for step in ({"begin": True}, {"add": "cogging 24"}, {"add": "stribeck"}, {"undo": True}, {"add": "stribeck"}):
        began = time.perf_counter()
        client.ask("POST", "steps", step)
        client.idle()
        print(f"rung, 30 s at 1 kHz, {json.dumps(step)}: {time.perf_counter() - began:.2f} s")


def upload(client: Client, folder: Path) -> None:
    """A table of text of 200 MB."""
    path = written(folder / "large.csv", 200.0)
    client.ask("POST", "design", {"example": "seed_motor"})
    began = time.perf_counter()
    client.upload(path)
    server, reader = client.memory()
    size = path.stat().st_size / 1e6
    print(
        f"upload of {size:.0f} MB: {time.perf_counter() - began:.1f} s until its channels are shown; at most "
        f"{server:.0f} MB in the server, {reader:.0f} MB in its session's process"
    )


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=("zoom", "rung", "upload"))
    chosen = parser.parse_args().only
    for measure in (zoom, rung, upload):
        if chosen in (None, measure.__name__):
            with tempfile.TemporaryDirectory() as name, served(Path(name)) as session:
                measure(session(), Path(name))


if __name__ == "__main__":
    main()
