"""Ten million rows in under ten seconds, and pieces that need little memory."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.importers import read_log

ROWS = 10_000_000


@pytest.fixture(scope="module")
def large(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pyarrow = pytest.importorskip("pyarrow")
    writer = pytest.importorskip("pyarrow.csv")
    path = tmp_path_factory.mktemp("large") / "log.csv"
    t = np.arange(ROWS) * 62.5e-6
    theta = 40.0 * (1.0 - np.cos(np.pi * t))
    table = pyarrow.table({"t [s]": t, "theta [rad]": theta, "i_q [A]": np.sin(t), "u_q [V]": np.cos(t)})
    writer.write_csv(table, path, writer.WriteOptions(quoting_style="none"))
    yield path
    path.unlink()


@pytest.mark.slow
def test_ten_million_rows(large: Path) -> None:
    start, used = time.perf_counter(), time.process_time()
    log = read_log(large)
    seconds, used = time.perf_counter() - start, time.process_time() - used
    size = large.stat().st_size / 1e6
    print(f"{ROWS} rows, 4 columns, {size:.0f} MB: {seconds:.2f} s on the clock, {used:.2f} s of all processors")
    assert len(log) == ROWS
    assert log["theta"][-1] == 40.0 * (1.0 - np.cos(np.pi * (np.arange(ROWS) * 62.5e-6)))[-1]
    # Work, not the clock: other programs on the machine must not decide. With two free processors the clock
    # shows less than this sum over the threads.
    assert used < 10.0


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="reads the peak memory from Linux")
def test_pieces_stay_small(large: Path) -> None:
    # VmHWM and not ru_maxrss: the latter is handed down from the parent process
    code = (
        "import re, sys; from pmsm_ctrl.importers import read_pieces\n"
        "n = sum(len(part) for part in read_pieces(sys.argv[1], rows=200_000))\n"
        "print(n, re.search(r'VmHWM:\\s+(\\d+)', open('/proc/self/status').read())[1])"
    )
    run = subprocess.run([sys.executable, "-c", code, str(large)], capture_output=True, text=True, check=True)
    rows, kilobytes = map(int, run.stdout.split())
    print(f"peak {kilobytes / 1e3:.0f} MB for a file of {large.stat().st_size / 1e6:.0f} MB")
    assert rows == ROWS
    assert kilobytes < 400_000
