"""kill -9 at the worst moments: every output is the old one or the new one, whole, and the next run is none the worse.

The worst moments are reached on purpose: a child kills itself right where a write begins, when half of it is out,
just before and just after the new file takes the old one's place. Others are killed at random.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

import pmsm_ctrl
from pmsm_ctrl import Design
from pmsm_ctrl.errors import CacheWarning, RequestError
from pmsm_ctrl.files import STALE, atomic_path, require_writable, write_text
from pmsm_ctrl.importers import read_log
from pmsm_ctrl.log import Log
from tests import effort
from tests.effort import amount, slow

pytestmark = pytest.mark.skipif(os.name == "nt", reason="POSIX signals")

PACKAGE = Path(pmsm_ctrl.__file__).parent
SEED_MOTOR = Path(__file__).resolve().parents[2] / "designs" / "seed_motor.toml"
OLD = b"old and whole\n"
# Forks for every line of its input; the child runs the command line, and kills itself at the chosen moment of the
# chosen write. What takes long, loading the package, is done once.
SERVER = """
import json, os, signal, sys, tempfile
import pmsm_ctrl
from pmsm_ctrl.cli import main
verbs = [getattr(pmsm_ctrl, name) for name in sys.argv[1:]]
def die():
    os.kill(os.getpid(), signal.SIGKILL)
def here(name):  # and not in the cache of compiled kernels
    return str(name).endswith(".part") and os.path.dirname(os.path.realpath(name)) == os.getcwd()
def run(moment, count, words):
    seen = 0
    make, replace = tempfile.mkstemp, os.replace
    def mkstemp(*words, **named):
        nonlocal seen
        out = make(*words, **named)
        seen += here(out[1])
        if moment == "begin" and here(out[1]) and seen == count:
            die()
        return out
    def replaced(source, target, **named):
        if here(source) and seen == count:
            if moment == "half":
                os.truncate(source, os.path.getsize(source) // 2)
                die()
            if moment == "before":
                die()
        replace(source, target, **named)
        if here(source) and seen == count and moment == "after":
            die()
    tempfile.mkstemp, os.replace = mkstemp, replaced
    main(words)
for line in sys.stdin:
    folder, moment, count, words = json.loads(line)
    child = os.fork()
    if child == 0:
        os.dup2(2, 1)
        os.chdir(folder)
        run(moment, count, words)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


@pytest.fixture(scope="module")
def run() -> Iterator[Callable[..., int]]:
    """Return a function that runs a command line in a process of its own and returns its exit status."""
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    verbs = pmsm_ctrl.__all__ if effort.WHOLE else ["simulate"]  # all of them take 4 s
    server = subprocess.Popen([sys.executable, "-c", SERVER, *verbs], **pipes)

    def ask(folder: Path, words: list[str], moment: str = "never", count: int = 0) -> int:
        server.stdin.write(json.dumps([str(folder), moment, count, words]) + "\n")
        server.stdin.flush()
        return int(server.stdout.readline())

    yield ask
    server.communicate(timeout=60)


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twenty seconds of the reference motor's torque balance in closed form."""
    t = np.arange(0, 20, 1e-3)
    omega = 80 * np.sin(np.pi * t) + 40 * np.sin(2.6 * np.pi * t + 1)
    alpha = 80 * np.pi * np.cos(np.pi * t) + 104 * np.pi * np.cos(2.6 * np.pi * t + 1)
    noise = np.random.default_rng(5).normal(0, 1e-3, t.size)
    i_q = (9e-5 * alpha + 0.0213 * np.sign(omega) + 1.68e-4 * omega + noise) / 1.032
    return Log({"t": t, "omega": omega, "i_q": i_q}).write_csv(tmp_path_factory.mktemp("record") / "axis.csv")


# Those that write a single file; a design is written the same way by two, which share the moments.
MOMENTS = {"add": ["begin", "before"], "tune": ["half", "after"], "export": ["begin", "half", "before", "after"]}
SHORT = ["--set", "speed_max=20", "--set", "speed_step=20", "--set", "dwell=0.2"]
COMMANDS: dict[str, tuple[list[str], list[str]]] = {
    "simulate": (["simulate", "DESIGN", *SHORT, "--output", "out.csv", "--json", "out.json"], ["out.csv", "out.json"]),
    "identify": (
        ["identify", "LOG", "--design", "DESIGN", "--json", "out.json", "--output", "out.toml", "--report", "out.html"],
        ["out.json", "out.html", "out.toml"],
    ),
    "add": (
        ["add", "unbalance", "--design", "DESIGN", "--log", "LOG", "--output", "out.toml"],
        ["out.toml"],
    ),
    "tune": (["tune", "DESIGN", "--no-prove", "--output", "out.toml"], ["out.toml"]),
    "import": (["import", "LOG", "--output", "out.csv"], ["out.csv", "out.log.toml"]),
    "export": (["export", "DESIGN", "--language", "c", "--output", "out.c"], ["out.c"]),
}


def words(command: str, record: Path) -> list[str]:
    given = {"DESIGN": str(SEED_MOTOR), "LOG": str(record)}
    return [*(given.get(word, word) for word in COMMANDS[command][0]), "--force"]  # the old outputs are there


def whole(path: Path) -> bool:
    """Whether a file is a complete new output."""
    content = path.read_bytes()
    if path.name.endswith(".csv"):
        return len(read_log(path)) > 100 and content.endswith(b"\n")
    if path.name.endswith(".json"):
        return bool(json.loads(content))
    if path.name.endswith("log.toml"):
        return b"[log.channels]" in content and content.endswith(b"\n")
    if path.name.endswith(".toml"):
        return Design.read(path).name == "seed_motor"
    return content.rstrip().endswith((b"</html>", b"}", b"*/", b"#endif"))


def look(folder: Path, outputs: list[str]) -> list[bool]:
    """Check that every output is old or new; return which are new."""
    new = []
    for name in outputs:
        path = folder / name
        new.append(path.read_bytes() != OLD)
        assert not new[-1] or whole(path), f"{name} is neither old nor new"
    return new


@pytest.mark.parametrize("command", ["simulate", "import", *map(slow, ("identify", "add", "tune", "export"))])
def test_killed_where_it_writes(run: Callable[..., int], tmp_path: Path, record: Path, command: str) -> None:
    outputs = COMMANDS[command][1]
    for name in outputs:
        (tmp_path / name).write_bytes(OLD)
    dice = random.Random(command)
    for moment in MOMENTS.get(command) or dice.sample(["begin", "half", "before"], amount(1, 2)):
        count = dice.randint(1, len(outputs))
        assert run(tmp_path, words(command, record), moment, count) == -signal.SIGKILL
        new = look(tmp_path, outputs)
        assert new == [k < count - (moment != "after") for k in range(len(outputs))]
        for name in outputs:
            (tmp_path / name).write_bytes(OLD)
    # what the killed ones left behind does no harm
    assert list(tmp_path.glob(".*.part"))
    assert run(tmp_path, words(command, record)) == 0
    assert all(look(tmp_path, outputs))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_killed_at_random(tmp_path: Path, record: Path, seed: int) -> None:
    dice = random.Random(seed)
    command = dice.choice([*COMMANDS, "study"])
    if command == "study":
        command, line, outputs = (
            "study",
            ["study", str(SEED_MOTOR), "--log", str(record), "-o", "out.html", "--force"],
            ["out.html"],
        )
    else:
        line, outputs = words(command, record), COMMANDS[command][1]
    for name in outputs:
        (tmp_path / name).write_bytes(OLD)
    process = subprocess.Popen([sys.executable, "-m", "pmsm_ctrl", *line], cwd=tmp_path,
                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # fmt: skip
    time.sleep(dice.uniform(0.3, 12.0 if command == "study" else 4.0))
    process.kill()
    process.wait()
    look(tmp_path, outputs)


# ---- the cache of compiled kernels ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a copy of the package: its cache is keyed on all sources, which somebody may be editing."""
    folder = tmp_path_factory.mktemp("copy")
    shutil.copytree(PACKAGE, folder / "pmsm_ctrl", ignore=shutil.ignore_patterns("__pycache__"))
    return folder


def simulated(folder: Path, cache: Path, kill_after: float | None = None) -> str:
    """Simulate with a cache of its own; return what was said on stderr."""
    line = [sys.executable, "-m", "pmsm_ctrl", "simulate", str(SEED_MOTOR), *SHORT, "--output", "log.csv", "--force"]
    environment = os.environ | {"PMSM_CTRL_CACHE": str(cache)}
    environment.pop("NUMBA_CACHE_DIR", None)
    streams = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(line, cwd=folder, env=environment, **streams)
    if kill_after is not None:
        time.sleep(kill_after)
        process.kill()
    said: str = process.communicate(timeout=300)[1]
    assert kill_after is not None or process.returncode == 0, said
    return said


@pytest.mark.slow  # damage to single files is tested below
def test_a_cache_that_was_killed_or_damaged(copy: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    for seconds in (1.5, 3.0)[: amount(1, 2)]:
        simulated(copy, cache, kill_after=seconds)
    assert simulated(copy, cache) == "", "a killed compilation is no damage"
    reference = (copy / "log.csv").read_bytes()
    for k, path in enumerate(sorted(cache.rglob("*.*"))):
        damaged = {".nbi": b"", ".nbc": b"\x80\x04garbage", ".py": b"\xff\xfe rubbish"}
        if path.suffix == ".py" or (path.suffix in damaged and k % 2):
            path.write_bytes(damaged[path.suffix])
    said = simulated(copy, cache)
    assert said.startswith(f"pmsm-ctrl: the cache of compiled kernels in {cache}")
    assert "is damaged" in said
    assert said.count("\n") == 1
    assert (copy / "log.csv").read_bytes() == reference
    assert simulated(copy, cache) == "", "repaired"


def test_a_second_place_of_the_package_finds_what_the_first_compiled(tmp_path: Path) -> None:
    line = (
        "from pmsm_ctrl.kernels.rotation import cos_small; import numba\n"
        "@numba.njit\ndef outer(x): return cos_small(x)\n"
        "outer(0.1); print(len(cos_small.stats.cache_hits), len(cos_small.stats.cache_misses))"
    )
    said = []
    for name in ("first", "second"):
        shutil.copytree(PACKAGE, tmp_path / name / "pmsm_ctrl", ignore=shutil.ignore_patterns("__pycache__"))
        environment = os.environ | {"PMSM_CTRL_CACHE": str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path / name)}
        environment.pop("NUMBA_CACHE_DIR", None)
        said.append(subprocess.check_output([sys.executable, "-c", line], cwd=tmp_path / name, env=environment))
    assert [text.split() for text in said] == [[b"0", b"1"], [b"1", b"0"]]


@pytest.mark.parametrize(
    ("suffix", "damage"),
    [
        (".nbc", "one bit"),
        *((suffix, damage) for suffix in (".nbi", ".nbc") for damage in ("emptied", "cut", "zeroed")),
    ],
)
def test_a_damaged_file_of_the_cache_is_compiled_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str, damage: str
) -> None:
    """What numba alone would end a command with, or run: see `pmsm_ctrl.kernels.cache`."""
    from pmsm_ctrl.kernels import cache as caching
    from pmsm_ctrl.kernels import cache_folder, kernel

    monkeypatch.setenv("PMSM_CTRL_CACHE", str(tmp_path))
    source = cache_folder() / "doubled.py"  # what is generated there is kept on disk, as the package's own kernels are
    source.parent.mkdir()
    source.write_text("def doubled(x):\n    return 2.0 * x\n", encoding="utf-8")
    scope: dict[str, object] = {}
    exec(compile(source.read_text(encoding="utf-8"), str(source), "exec"), scope)
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path / "cache"))
    assert kernel(scope["doubled"])(1.5) == 3.0
    (path,) = (tmp_path / "cache").rglob(f"*{suffix}")
    content = bytearray(path.read_bytes())
    if damage == "one bit":
        content[len(content) // 2] ^= 1
    else:
        content = {"emptied": b"", "cut": content[: len(content) // 2], "zeroed": bytes(len(content))}[damage]
    path.write_bytes(content)
    caching._say.cache_clear()
    with pytest.warns(CacheWarning, match="is damaged"):
        assert kernel(scope["doubled"])(1.5) == 3.0
    assert kernel(scope["doubled"])(1.5) == 3.0


# ---- the one way of writing -------------------------------------------------------------------------------------


def test_stale_leftovers_are_swept_up_and_fresh_ones_are_not(tmp_path: Path) -> None:
    stale, fresh, other = (tmp_path / name for name in (".a.json.x.part", ".a.json.y.part", ".b.json.x.part"))
    for path in (stale, fresh, other):
        path.write_text("half")
    past = time.time() - STALE - 10
    os.utime(stale, (past, past))
    os.utime(other, (past, past))
    write_text(tmp_path / "a.json", "{}")
    assert sorted(p.name for p in tmp_path.iterdir()) == [".a.json.y.part", ".b.json.x.part", "a.json"]


def test_an_exception_leaves_the_old_file(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    target.write_bytes(OLD)
    with suppress(ZeroDivisionError), atomic_path(target) as temporary:
        temporary.write_text("half")
        raise ZeroDivisionError
    assert target.read_bytes() == OLD
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_links_permissions_and_pipes(tmp_path: Path) -> None:
    target, link, pipe = tmp_path / "a.txt", tmp_path / "link", tmp_path / "pipe"
    target.write_bytes(OLD)
    target.chmod(0o600)
    link.symlink_to(target)
    write_text(link, "new")
    assert link.is_symlink()
    assert target.read_text() == "new"
    assert target.stat().st_mode & 0o777 == 0o600
    os.mkfifo(pipe)
    reader = subprocess.Popen(["cat", str(pipe)], stdout=subprocess.PIPE, text=True)
    write_text(pipe, "through")
    assert reader.communicate(timeout=20)[0] == "through"
    assert pipe.is_fifo()
    write_text("/dev/null", "gone")
    assert Path("/dev/null").is_char_device()


@pytest.mark.parametrize("name", ["none/a.txt", ".", "a\0b", "x" * 300, "file/a.txt"])
def test_a_place_that_cannot_be_written(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").write_bytes(OLD)
    for attempt in (require_writable, lambda path: write_text(path, "new")):
        with pytest.raises(RequestError) as caught:
            attempt(os.path.join(tmp_path, name))
        assert "\n" not in str(caught.value)
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_every_output_is_checked_before_the_work(
    tmp_path: Path, record: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from pmsm_ctrl.cli import main

    monkeypatch.chdir(tmp_path)
    line = ["identify", str(record), "--design", str(SEED_MOTOR), "--json", "r.json", "--report", "none/r.html"]
    with pytest.raises(SystemExit) as left:
        main(line)
    assert left.value.code == 2
    assert "none/r.html: cannot write here (no folder 'none')" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
    before = record.read_bytes()
    with pytest.raises(SystemExit):
        main(["import", str(record), "--output", str(record)])
    assert "is an input of this command" in capsys.readouterr().err
    assert record.read_bytes() == before
