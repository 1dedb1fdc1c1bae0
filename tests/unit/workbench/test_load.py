"""Long use: fifty uploads and a thousand zooms in a row, in a server of its own, leave its memory as it was."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("uvicorn", reason="UVICORN ABSENT: pip install 'pmsm-ctrl[workbench]'")
if not sys.platform.startswith("linux"):
    pytest.skip("NOT LINUX: the memory of a process is read from /proc", allow_module_level=True)

from tests.benchmarks.workbench import CHANNELS, Client, served, written

UPLOADS, WARM, ZOOMS = 50, 10, 1000
MEGABYTES = 5.0  # of a file; its log takes 4 MB, so that one kept by each upload would be seen
MOST = 30.0  # MB


def zoomed(client: Client, log: str, stop: float, count: int) -> None:
    rng = np.random.default_rng(count)
    for _ in range(count):
        start, end = np.sort(rng.uniform(0.0, stop, 2))
        client.ask("GET", f"view/log?log={log}&channels={CHANNELS}&bins=800&start={start}&stop={end}")


@pytest.mark.slow
def test_fifty_uploads_and_a_thousand_zooms_leave_memory_flat(tmp_path: Path) -> None:
    path = written(tmp_path / "log.csv", MEGABYTES)
    with served(tmp_path) as session:
        client = session()
        client.ask("POST", "design", {"example": "seed_motor"})
        memory = []
        for _ in range(UPLOADS):
            state = client.upload(path)
            log, stop = state["logs"][-1]["id"], state["logs"][-1]["info"]["stop"]
            zoomed(client, log, stop, ZOOMS // UPLOADS)
            memory.append(client.memory("VmRSS"))
            client.ask("DELETE", f"logs/{log}")
        server, reader = np.array(memory[WARM:]).T
        print(f"server {server[0]:.1f} to {server.max():.1f} MB, reader {reader[0]:.1f} to {reader.max():.1f} MB")
        assert server.max() - server[0] < MOST
        assert reader.max() - reader[0] < MOST
        sizes = [one.stat().st_size for one in (tmp_path / "sessions").rglob("*") if one.is_file()]
        assert sum(sizes) < 1e6, "files of logs that were removed"
