"""What surrounds a command: streams closed or full, folders that are gone, pipes for files, numbers none means."""

from __future__ import annotations

import errno
import io
import json
import os
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl.cli import app
from pmsm_ctrl.console import run
from pmsm_ctrl.diagnose.resonance import read_measured
from pmsm_ctrl.effects.evaluate import column
from pmsm_ctrl.effects.loading import load_effects
from pmsm_ctrl.errors import CacheWarning, DesignError, LogError, RequestError
from pmsm_ctrl.fleet import read_manifest
from pmsm_ctrl.frf.bode import is_bode_file, read_bode
from pmsm_ctrl.importers import read_log
from pmsm_ctrl.log import Log
from pmsm_ctrl.next_steps import next_step
from pmsm_ctrl.report.history import read_history
from tests.effort import seeds

AXIS = (
    "[motor]\nJ = 1e-4\nK_t = 1.0\n[[effects]]\nid = 'coulomb'\nF_c = 0.02\n[[effects]]\nid = 'viscous'\nF_v = 2e-4\n"
)
OWN = """
import dataclasses

from pmsm_ctrl.effects import CATALOGUE

mine = dataclasses.replace(CATALOGUE["viscous"], id="mine")
"""
posix = pytest.mark.skipif(os.name == "nt", reason="POSIX files")


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with a design and a log in closed form."""
    monkeypatch.chdir(tmp_path)
    t = np.arange(0, 6, 1e-3)
    omega = 80 * np.sin(np.pi * t) + 40 * np.sin(2.6 * np.pi * t + 1)
    alpha = 80 * np.pi * np.cos(np.pi * t) + 104 * np.pi * np.cos(2.6 * np.pi * t + 1)
    torque = 1e-4 * alpha + 0.02 * np.sign(omega) + 2e-4 * omega + np.random.default_rng(5).normal(0, 1e-3, t.size)
    Log({"t": t, "omega": omega, "torque": torque}).write_csv("l.csv")
    Path("d.toml").write_text(AXIS, encoding="utf-8")
    return tmp_path


# -- streams --


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
@pytest.mark.parametrize("line", [["--version"], ["schema", "diagnose"]])
def test_a_full_disk_behind_standard_output_is_told(
    line: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with open("/dev/full", "w", encoding="utf-8") as full:
        monkeypatch.setattr(sys, "stdout", full)
        assert run(app, line) == 2
    assert capsys.readouterr().err == "pmsm-ctrl: standard output: cannot be written (No space left on device)\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_behind_standard_error_leaves_the_status(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with open(os.open("/dev/full", os.O_WRONLY), "wb", buffering=0) as full:
        monkeypatch.setattr(sys, "stderr", io.TextIOWrapper(full, encoding="utf-8", write_through=True))
        assert run(app, ["identify", "none.csv", "-d", "d.toml"]) == 2
        monkeypatch.undo()


def test_without_standard_error_no_error_is_taken_for_an_answer(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What is printed to a stream that is None goes to standard output."""
    monkeypatch.setattr(sys, "stderr", None)
    assert run(app, ["identify", "none.csv", "-d", "d.toml"]) == 2
    assert capsys.readouterr().out == ""


def test_without_standard_input_nobody_is_asked(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdin", None)
    np.savetxt("plain.txt", np.loadtxt("l.csv", delimiter=",", skiprows=1), fmt="%.9g")
    assert run(app, ["import", "plain.txt", "-d", "d.toml"]) == 2
    assert "has not been confirmed" in capsys.readouterr().err
    assert run(app, ["init", "axis"]) == 2
    assert "unexpected" not in capsys.readouterr().err


# -- folders, names and variables --


@posix
def test_a_current_folder_that_is_gone(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    gone = here / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    assert run(app, ["identify", "../l.csv", "-d", "../d.toml", "--json", "r.json"]) == 2
    assert "unexpected" not in capsys.readouterr().err


def test_an_unknown_backend_of_matplotlib_ends_no_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MPLBACKEND", "no_such_backend")
    assert run(app, ["--version"]) == 0
    assert os.environ["MPLBACKEND"] == "agg"


@pytest.mark.skipif(sys.platform != "linux", reason="names of any bytes")
def test_a_name_that_is_no_text(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    odd = os.fsdecode(b"a\xffb.csv")
    Path("l.csv").rename(odd)
    assert run(app, ["identify", odd, "-d", "d.toml", "--json", "r.json", "--report", "r.html"]) == 0
    assert json.loads(Path("r.json").read_text(encoding="utf-8"))["log"] == odd
    assert "\ufffd" in capsys.readouterr().out


def test_a_full_disk_under_the_cache_costs_time_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from pmsm_ctrl.kernels import cache as caching
    from pmsm_ctrl.kernels import cache_folder, kernel

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setenv("PMSM_CTRL_CACHE", str(tmp_path))
    source = cache_folder() / "tripled.py"
    source.parent.mkdir()
    source.write_text("def tripled(x):\n    return 3.0 * x\n", encoding="utf-8")
    scope: dict[str, Any] = {}
    exec(compile(source.read_text(encoding="utf-8"), str(source), "exec"), scope)
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(caching._CheckedFile, "_save_data", full)
    caching._say.cache_clear()
    with pytest.warns(CacheWarning, match=r"cannot be written \(No space left on device\): every start compiles anew"):
        assert kernel(scope["tripled"])(1.5) == 4.5


@pytest.mark.parametrize("verb", ["identify", "track", "frf"])
def test_a_log_with_a_torque_is_not_asked_for_a_current(
    verb: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(app, [verb, "l.csv", "-d", "d.toml"]) in (0, 2)
    assert "--map" not in capsys.readouterr().err


@pytest.mark.parametrize("count", seeds(1000, 100_000))
def test_any_number_of_effects_is_one_line_or_an_answer(
    count: int, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("many.toml").write_text(AXIS + "[[effects]]\nid = 'constant_load'\nT_0 = 0.01\n" * count, encoding="utf-8")
    assert run(app, ["identify", "l.csv", "-d", "many.toml"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("pmsm-ctrl: many.toml: ")
    assert len(said) < 400


# -- files that are none --

READERS: list[Callable[[Path], object]] = [read_measured, read_history, read_manifest, read_bode, read_log]


@posix
@pytest.mark.parametrize("read", READERS, ids=lambda read: read.__name__)
def test_a_pipe_is_not_waited_for(read: Callable[[Path], object], tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for source in (pipe, Path("/dev/zero")):
        assert not is_bode_file(source)
        with pytest.raises((LogError, RequestError), match=source.name):
            read(source)


@pytest.mark.skipif(not Path("/proc/kmsg").exists(), reason="no /proc")
def test_what_the_kernel_makes_up_is_not_waited_for() -> None:
    with pytest.raises(LogError, match=r"/proc/kmsg: (empty|cannot be read)"):
        read_log("/proc/kmsg")


@pytest.mark.parametrize("read", READERS[:3], ids=lambda read: read.__name__)
@pytest.mark.parametrize(
    "content", ["[" * 200_000, "a = " + "[" * 20_000, "a" + ".a" * 100_000 + " = 1", "x = " + "1" * 9999]
)
def test_depth_and_length_are_no_fault_of_the_program(
    read: Callable[[Path], object], content: str, tmp_path: Path
) -> None:
    path = tmp_path / "deep"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(RequestError, match="deep"):
        read(path)


@pytest.mark.parametrize("read", READERS[:3], ids=lambda read: read.__name__)
def test_a_file_without_end_is_not_read(read: Callable[[Path], object], tmp_path: Path) -> None:
    path = tmp_path / "large"
    with open(path, "wb") as stream:
        stream.truncate(1 << 36)
    with pytest.raises(RequestError, match="larger than 64 MB"):
        read(path)


@pytest.mark.parametrize("name", ["json", "numpy", "control"])
def test_own_effects_take_no_module_s_place(name: str, tmp_path: Path) -> None:
    """A file ``json.py`` stood in the place of that module for the rest of the command."""
    path = tmp_path / f"{name}.py"
    path.write_text(OWN, encoding="utf-8")
    before = sys.modules.get(name)
    assert [effect.id for effect in load_effects(path)] == ["mine"]
    assert sys.modules.get(name) is before


# -- numbers --


@pytest.mark.parametrize(
    "line",
    [
        "identify l.csv -d d.toml --cutoff nan", "identify l.csv -d d.toml --cutoff inf",
        "compensate d.toml --step nan", "tune d.toml --phase-margin nan", "tune d.toml --speed-bandwidth inf",
        "tune d.toml --speed-bandwidth 0", "tune d.toml --current-bandwidth -3", "tune d.toml --phase-margin 0",
        "track -d d.toml --live l.csv --idle nan", "import l.csv --rate nan", "import l.csv --rate 1e300",
        "import l.csv --rate -1", "compare l.csv -d d.toml --max-error inf", "compare l.csv -d d.toml --max-error nan",
        "diagnose l.csv -d d.toml --calibrate 1000000000", "diagnose l.csv -d d.toml --calibrate -5",
        "sweep d.toml --repeats 1000000000", "fleet . -d d.toml --jobs 100000000", "fleet watch . --every nan",
    ],
)  # fmt: skip
def test_a_number_that_no_option_means_is_refused_at_once(
    line: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(app, shlex.split(line)) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "expected" in said or "Invalid value" in said


def test_a_fleet_with_own_effects_says_how_it_is_tried_again() -> None:
    """It ended with status 70 after all its work: the file was sought in an attribute that it does not have."""
    given = {"words": ["logs"], "design": Path("d.toml"), "effects": Path("own.py"), "mapping": ["omega=n [rpm]"]}
    words = shlex.split(next_step("fleet", given, "set_aside"))
    assert words[:3] == ["pmsm-ctrl", "fleet", "logs"]
    assert words[words.index("--effects") + 1] == "own.py"
    assert words[-1] == "--retry"


def test_the_command_line_asks_for_one_thread_before_the_libraries_are_loaded() -> None:
    code = (
        "import os, sys; import pmsm_ctrl.__main__ as command; assert 'numpy' not in sys.modules\n"
        "sys.argv = ['pmsm-ctrl', '--help']\n"
        "try:\n    command.main()\nfinally:\n    print(os.environ['OPENBLAS_NUM_THREADS'], file=sys.stderr)\n"
    )
    for asked, wanted in (({}, "1"), ({"OPENBLAS_NUM_THREADS": "3"}, "3")):
        kept = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
        ended = subprocess.run(
            [sys.executable, "-c", code], env=kept | asked, capture_output=True, text=True, check=True
        )
        assert ended.stderr.split() == [wanted]


def test_a_verb_called_from_python_uses_one_thread_and_gives_the_others_back() -> None:
    """Counted by threadpoolctl itself, in a process that nobody told how many threads there are."""
    code = (
        "import numpy, pmsm_ctrl, scipy.linalg, threadpoolctl\n"
        "def threads():\n"
        "    return {one['num_threads'] for one in threadpoolctl.threadpool_info() if one['user_api'] == 'blas'}\n"
        "before, seen = threads(), []\n"
        "pmsm_ctrl.rooms.Room._function = property(lambda room: lambda: seen.append(threads()))\n"
        "pmsm_ctrl.tune()\n"
        "assert seen == [{1}], seen\n"
        "assert threads() == before\n"
    )
    untold = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    done = subprocess.run([sys.executable, "-c", code], env=untold, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


BROKEN = """from pmsm_ctrl.effects import Effect, Parameter, kernel
@kernel
def drag(omega: float, k: float) -> float:
    return {body}
own = Effect(id="own_drag", title="Drag", equation="k", source="own", enters="torque",
             parameters=(Parameter("k", "N m", 0.0, -9.0, 9.0, "of it", linear=True),),
             term=drag, needs="speed", validated="not at all")
"""


def test_an_undefined_name_in_an_own_effect_is_one_line(tmp_path: Path) -> None:
    """It was an unexpected TypingError with colours of a terminal, to be reported, and status 70."""
    path = tmp_path / "own.py"
    path.write_text(BROKEN.format(body="k * omega_zzz"), encoding="utf-8")
    with pytest.raises(RequestError, match=r"own\.py: effect 'own_drag': function 'drag': name 'omega_zzz' is not def"):
        load_effects(path)


def test_what_numba_refuses_in_an_own_effect_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "own.py"
    path.write_text(BROKEN.format(body="k * omega.no_such_thing"), encoding="utf-8")
    (effect,) = load_effects(path)
    with pytest.raises(DesignError) as found:
        column(effect, {"omega": np.ones(3)}, {"k": 1.0})
    said = str(found.value)
    assert said.startswith("own.py: effect 'own_drag': function 'drag' cannot be compiled: ")
    assert "\n" not in said
    assert "\x1b" not in said
