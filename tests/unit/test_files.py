"""No output of a command is one of its inputs; what cannot be written is told by its name."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from pmsm_ctrl.cli import main
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.files import atomic_path, require_distinct, write_text

SEED_MOTOR = Path(__file__).resolve().parents[2] / "designs" / "seed_motor.toml"
LOG = "t [s],omega [rad/s],torque [N m]\n" + "".join(f"{k * 1e-3:.3f},{k % 7},0.1\n" for k in range(20))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "l.csv").write_text(LOG, encoding="utf-8")
    (tmp_path / "d.toml").write_bytes(SEED_MOTOR.read_bytes())
    (tmp_path / "own.py").write_text("EFFECTS = ()\n", encoding="utf-8")
    (tmp_path / "soft.csv").symlink_to("l.csv")
    os.link(tmp_path / "l.csv", tmp_path / "hard.csv")
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "a.csv").write_text(LOG, encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize(
    "line",
    [
        "identify l.csv -d d.toml --json l.csv",
        "identify l.csv -d d.toml --report l.csv",
        "identify l.csv -d d.toml -o d.toml",
        "identify l.csv -d d.toml --json soft.csv",
        "identify l.csv -d d.toml --json hard.csv",
        "identify soft.csv -d d.toml --json ./logs/../l.csv",
        "identify logs -d d.toml --json logs/a.csv",
        "identify l*.csv -d d.toml --json l.csv",
        "compare l.csv -d d.toml --holdout logs/a.csv --report logs/a.csv",
        "import l.csv --json l.csv",
        "import l.csv -o l.csv",
        "simulate d.toml -o d.toml",
        "simulate d.toml --truth own.py -o own.py",
        "study d.toml --log l.csv -o r.html --history l.csv",
        "identify l.csv -d d.toml --json r.json --report r.json",
        "export d.toml -l c -o d.toml",
    ],
)
def test_an_output_that_is_an_input_is_refused(line: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    with pytest.raises(SystemExit) as left:
        main(line.split())
    assert left.value.code == 2
    said = capsys.readouterr().err
    assert "name another file" in said
    assert said.count("\n") == 1
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_the_table_beside_an_imported_log_does_not_replace_the_design(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    design = folder / "new.log.toml"
    design.write_bytes(SEED_MOTOR.read_bytes())
    with pytest.raises(SystemExit) as left:
        main(["import", "l.csv", "-d", "new.log.toml", "-o", "new.csv"])
    assert left.value.code == 2
    assert "new.log.toml: is an input" in capsys.readouterr().err
    assert design.read_bytes() == SEED_MOTOR.read_bytes()


def test_a_device_may_be_named_twice() -> None:
    require_distinct([Path(os.devnull), Path(os.devnull)], [])


def test_a_full_disk_is_told_with_the_name_of_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = tmp_path / "out.json"
    kept.write_text("old", encoding="utf-8")

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(RequestError, match=r"out\.json: cannot be written \(No space left on device\)"):
        write_text(kept, "new")
    monkeypatch.undo()
    assert [path.name for path in tmp_path.iterdir()] == ["out.json"]
    assert kept.read_text(encoding="utf-8") == "old"
    with pytest.raises(KeyError), atomic_path(kept):  # an error of the work itself is left as it is
        raise KeyError
