"""Files, sizes and names that do harm: no output is an input, no size is a surprise, no name is a formula."""

from __future__ import annotations

import errno
import os
import sys
import unicodedata
from pathlib import Path

import numpy as np
import pytest
from matplotlib.text import Text

from pmsm_ctrl import Design, Log, compare, simulate
from pmsm_ctrl.cli import app, main
from pmsm_ctrl.console import run
from pmsm_ctrl.errors import DesignError, RequestError
from pmsm_ctrl.files import atomic_path, require_distinct, require_new, unused_name, write_text
from pmsm_ctrl.log import Provenance
from pmsm_ctrl.rendering.svg import inline_svg
from pmsm_ctrl.report.history import Entry
from pmsm_ctrl.report.present import history_section
from pmsm_ctrl.result import Estimate
from pmsm_ctrl.section import Picture
from pmsm_ctrl.simulate import scenario
from tests.effort import seeds

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


OVERWRITING = {
    "init": [
        "init axis -o kept",
        "init --example seed_motor -o kept",
        "init --example seed_motor -o n.toml --json kept",
    ],
    "simulate": ["simulate d.toml -o kept", "simulate d.toml -o n.csv --json kept"],
    "tune": ["tune d.toml -o kept", "tune d.toml --json kept", "tune d.toml --report kept"],
    "sweep": ["sweep d.toml -o kept", "sweep d.toml --json kept", "sweep d.toml --report kept"],
    "identify": [f"identify l.csv -d d.toml {option} kept" for option in ("-o", "--json", "--report")],
    "compare": [f"compare l.csv -d d.toml {option} kept" for option in ("--json", "--report")],
    "diagnose": [f"diagnose l.csv -d d.toml {option} kept" for option in ("-o", "--json", "--report")],
    "add": [
        f"add stribeck -d d.toml --log l.csv {more}" for more in ("-o kept", "-o n --json kept", "-o n --report kept")
    ],
    "frf": [f"frf l.csv -d d.toml {option} kept" for option in ("-o", "--json", "--report")],
    "quadrants": [f"quadrants l.csv l.csv -d d.toml {option} kept" for option in ("--json", "--report")],
    "verify": [f"verify l.csv l.csv -d d.toml {option} kept" for option in ("--json", "--report")],
    "track": [f"track l.csv -d d.toml {option} kept" for option in ("--json", "--report")],
    "fleet": [
        *(f"fleet logs -d d.toml {option} kept" for option in ("--json", "--report")),
        "fleet report logs -o kept",
    ],
    "compensate": [f"compensate d.toml {option} kept" for option in ("--json", "--report")],
    "export": [
        "export d.toml -l c -o kept.c",
        "export d.toml -l c --part tracker -o kept",
        "export d.toml -l c --json kept",
    ],
    "study": ["study d.toml -o kept", "study d.toml --json kept", "study d.toml --complete -o kept.html"],
    "import": ["import l.csv -o kept", "import l.csv -o table.csv", "import l.csv --json kept"],
    "workbench": [],
    "schema": [],
    "effects": ["effects stribeck -d d.toml -o kept", "effects --json kept", "effects stribeck --report kept"],
}


def test_the_table_of_overwriting_has_every_command() -> None:
    assert set(OVERWRITING) == {c.name or c.callback.__name__ for c in app.registered_commands if c.callback}


@pytest.mark.parametrize("line", [line for lines in OVERWRITING.values() for line in (seeds(*lines) if lines else ())])
def test_no_command_overwrites_a_file(line: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("kept", "kept.c", "table.log.toml"):
        (folder / name).write_text("mine", encoding="utf-8")
    (folder / "kept.html").symlink_to("kept")
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    with pytest.raises(SystemExit) as left:
        main(line.split())
    assert left.value.code == 2
    assert "exists; --force overwrites it" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_a_file_that_another_command_wrote_meanwhile_is_kept(tmp_path: Path) -> None:
    free, other = tmp_path / "r.csv", tmp_path / "r-2.csv"
    require_new([free])
    free.write_text("the other's", encoding="utf-8")
    with pytest.raises(RequestError, match="another command has written it meanwhile; this one"):
        write_text(free, "mine")
    assert (free.read_text(), other.read_text()) == ("the other's", "mine")
    write_text(free, "mine again")  # it was not found free since
    assert free.read_text() == "mine again"


@pytest.mark.parametrize("more", [[], ["--force"]])
def test_a_design_is_never_written_over_itself(
    more: list[str], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as left:
        main(["tune", "d.toml", "-o", "d.toml", *more])
    assert left.value.code == 2
    assert "d.toml: is an input" in capsys.readouterr().err
    assert (folder / "d.toml").read_bytes() == SEED_MOTOR.read_bytes()


def test_a_command_repeated_says_so_and_force_overwrites(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = ["import", "l.csv", "-m", "torque=torque [N m]", "-o", "n.csv", "--json", "n.json"]
    for more, status in ([], 0), ([], 2), (["--force"], 0):
        with pytest.raises(SystemExit) as left:
            main([*line, *more])
        assert (left.value.code or 0) == status
    assert "n.csv: exists; --force overwrites it" in capsys.readouterr().err


def test_a_folder_of_exported_files_is_not_overwritten(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = ["export", str(SEED_MOTOR.with_name("emps.toml")), "-l", "c", "-o", "axis"]
    for more, status in ([], 0), ([], 2), (["--force"], 0):
        with pytest.raises(SystemExit) as left:
            main([*line, *more])
        assert (left.value.code or 0) == status, more
    assert ": exists; --force overwrites it" in capsys.readouterr().err


def test_an_empty_file_and_a_device_may_be_written_to(folder: Path) -> None:
    (folder / "empty").touch()
    require_new([folder / "empty", Path(os.devnull), folder])


def test_the_next_free_name_of_a_report(folder: Path) -> None:
    page = folder / "axis.html"
    names = []
    for _ in range(3):
        names.append(unused_name(page))
        names[-1].touch()
    assert [name.name for name in names] == ["axis.html", "axis-2.html", "axis-3.html"]


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


@pytest.mark.parametrize("key", ["a." * 100_000 + "b", '"a" . ' * 100_000 + "b", "[" + "a." * 100_000 + "b]\nc"])
def test_a_design_with_a_key_of_many_parts_is_refused_before_it_is_read(key: str, tmp_path: Path) -> None:
    path = tmp_path / "deep.toml"
    path.write_text(f"{key} = 1\n", encoding="utf-8")
    with pytest.raises(DesignError, match=r"deep\.toml: a key of more than 32 parts"):
        Design.read(path)


def test_an_integer_of_many_digits_is_refused_with_the_name_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "digits.toml"
    path.write_text(f"x = {'1' * 5000}\n", encoding="utf-8")
    with pytest.raises(DesignError, match=r"^'[^(]*digits\.toml': cannot be read"):
        Design.read(path)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("triangle", {"cycles": 1e9}), ("trapezoid", {"cycles": 1e9}), ("creep", {"count": 1e8}),
        ("multisine", {"periods": 1e9}), ("positioning", {"count": 1e8}), ("sweep", {"speed_step": 1e-12}),
        ("sweep", {"speed_max": 1e308, "speed_step": 1.0}),
    ],
)  # fmt: skip
def test_the_size_of_a_motion_is_known_before_it_is_built(name: str, values: dict[str, float]) -> None:
    with pytest.raises(RequestError, match="whole number from 1 to 100000"):
        scenario(name, Design.read(SEED_MOTOR), **values)


def test_the_size_of_a_log_is_known_before_it_is_simulated() -> None:
    design = Design.read(SEED_MOTOR)
    with pytest.raises(RequestError, match=r"1e\+09 logged samples, at most"):
        simulate(design, scenario("hold", design, duration=1e6))


def test_a_motion_of_one_sample_is_no_log() -> None:
    """It was written "at nan Hz", with status 0."""
    design = Design.read(SEED_MOTOR)
    with pytest.raises(RequestError, match="less than 2 logged samples"):
        simulate(design, scenario("hold", design, duration=1e-7))


def test_an_empty_cache_variable_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    from pmsm_ctrl.kernels import cache_folder

    monkeypatch.setenv("XDG_CACHE_HOME", "")
    monkeypatch.setenv("PMSM_CTRL_CACHE", "")
    assert cache_folder().parent == Path.home() / ".cache" / "pmsm_ctrl"


def test_a_closed_output_is_no_fault_of_the_program(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", None)
    assert run(app, ["--version"]) == 0


@pytest.mark.slow
def test_dollar_signs_in_a_name_are_no_formula() -> None:
    """A log named so ended a study after all of its work: matplotlib takes text between two of them for a formula."""
    design = Design.read(SEED_MOTOR)
    log = simulate(design, "triangle").between(0.0, 8.0)
    named = Log(log.channels, log.motion, provenance=Provenance(file="a$\\frac{$b.csv"))
    entry = Entry("a$\\frac{$b.csv", ("", "", ""), {"F_c": Estimate(0.02, "N m", 1e-4)}, 0.1)
    for section in (compare(design, named).section(), history_section((entry, entry))):
        figures = []
        for block in section.blocks:
            if isinstance(block, Picture):
                figures.append(block.draw())
                inline_svg(block.draw, "p", "label")
        texts = [text.get_text() for figure in figures for text in figure.findobj(Text)]
        assert any("a$\\frac{$b.csv" in text for text in texts)


@pytest.mark.parametrize("name", ["a\x1b[31mred.csv", "a\u202egpj.csv", "a\x07\x9bb.csv", "line\u2028end.csv"])
def test_no_name_of_a_file_commands_the_terminal(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    t = 1e-3 * np.arange(200)
    Log({"t": t, "omega": np.sin(9 * t), "i_q": np.cos(9 * t)}).write_csv(name)
    for words in (["import", name, "-o", f"si_{name}"], ["init", "--example", "seed_motor", "-o", f"{name}.toml"]):
        with pytest.raises(SystemExit) as left:
            main(words)
        assert left.value.code == 0
        shown = capsys.readouterr()
        text = (shown.out + shown.err).replace("\n", "")
        assert not {c for c in text if unicodedata.category(c) in ("Cc", "Cf", "Zl", "Zp")}
        assert "\ufffd" in shown.out
