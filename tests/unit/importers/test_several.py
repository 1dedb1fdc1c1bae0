"""What stands on a command line for logs, and recordings appended to one file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers import log_files, read_log
from pmsm_ctrl.regression.joining import with_records


def written(path: Path, times: np.ndarray) -> Path:
    rows = "\n".join(f"{t!r},{3.0 * t!r},{0.1 + 0.01 * t!r}" for t in times.tolist())
    path.write_text(f"t [s],omega [rad/s],torque [N m]\n{rows}\n", encoding="utf-8")
    return path


def test_files_patterns_and_folders(tmp_path: Path) -> None:
    for name in ("run_10.csv", "run_2.csv", "run_1.CSV", "notes.md", ".hidden.csv"):
        (tmp_path / name).write_text("x", encoding="utf-8")
    assert [one.name for one in log_files([tmp_path])] == ["run_1.CSV", "run_2.csv", "run_10.csv"]
    assert [one.name for one in log_files([tmp_path / "run_*.csv"])] == ["run_2.csv", "run_10.csv"]
    odd = tmp_path / "[a].log"
    odd.write_text("x", encoding="utf-8")
    assert log_files([odd, tmp_path / "notes.md"]) == [odd, tmp_path / "notes.md"]


def test_what_names_no_log_is_refused(tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(LogError, match=r"empty: no log in this folder"):
        log_files([empty])
    with pytest.raises(LogError, match=r"run_\*.csv: no file matches"):
        log_files([tmp_path / "run_*.csv"])
    one = written(tmp_path / "a.csv", np.arange(10) * 1e-3)
    with pytest.raises(LogError, match=r"a.csv: given twice"):
        log_files([one, tmp_path])


def test_recordings_appended_to_one_file_become_records(tmp_path: Path) -> None:
    t = np.arange(400) * 0.01
    log = read_log(written(tmp_path / "day.csv", np.concatenate([t, t, t[:150]])))
    assert any("time starts again 2 times" in note for note in log.provenance.notes)
    parts = with_records(log).records
    assert [one.name.rpartition(", ")[2] for one in parts] == ["part 1", "part 2", "part 3"]
    assert [one.duration for one in parts] == pytest.approx([3.99, 3.99, 1.49])
    assert log["omega"][400:800] == pytest.approx(3.0 * t)


@pytest.mark.parametrize("at", [350, 60])
def test_time_that_only_stumbles_is_still_refused(tmp_path: Path, at: int) -> None:
    t = np.arange(400) * 0.01
    t[at:] -= 0.5 if at == 350 else 0.01 * at  # back by some samples; or again from the begin, too soon for a recording
    with pytest.raises(LogError, match=r"time runs backwards|same time stamp twice"):
        read_log(written(tmp_path / "bad.csv", t))
