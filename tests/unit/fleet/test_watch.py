"""A folder that is followed: logs that arrive are evaluated, those that are being written are not."""

from __future__ import annotations

import os
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from pmsm_ctrl.fleet import Engine, FleetResult, read_manifest
from pmsm_ctrl.fleet.watch import watch

pytest.importorskip("pyarrow")


def test_logs_are_evaluated_as_they_arrive(two_axes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    manifest = read_manifest(two_axes / "run.toml")
    logs = (str(tmp_path / "logs" / "*" / "*.csv"),)
    manifest = replace(manifest, logs=logs, results=str(tmp_path / "results"))
    first, second = tmp_path / "logs" / "a1" / "2026-03-01.csv", tmp_path / "logs" / "a1" / "2026-03-02.csv"
    first.parent.mkdir(parents=True)
    told: list[FleetResult] = []

    def arrives(source: Path, age: float) -> None:
        shutil.copy(two_axes / "logs" / "a1" / source.name, source)
        os.utime(source, (source.stat().st_atime - age, source.stat().st_mtime - age))

    happens = iter((
        lambda: arrives(first, 60.0), lambda: arrives(second, 0.0), lambda: arrives(second, 60.0), lambda: None,
    ))  # fmt: skip
    monkeypatch.setattr("time.sleep", lambda _: next(happens)())
    watch(manifest, told.append, every=1.0, passes=5, engine=Engine(jobs=1))
    assert [(one.evaluated, one.logs) for one in told] == [(1, 1), (1, 2)]
