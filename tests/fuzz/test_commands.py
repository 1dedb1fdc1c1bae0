"""Every command with any words and any damaged file: status 0, 1 or 2, one line where it is 2, nothing half-written."""

from __future__ import annotations

import io
import os
import re
import tempfile
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.main import get_command

from pmsm_ctrl.cli import app, main
from tests.effort import amount

SEED_MOTOR = Path(__file__).resolve().parents[2] / "designs" / "seed_motor.toml"
DESIGN = SEED_MOTOR.read_bytes()
LOG = b"t [s],theta [rad],i_q [A]\n" + b"".join(b"%d.5e-3,%d.25,%d.125\n" % (k, k * k % 97, k % 7) for k in range(150))
COMMANDS = get_command(app).commands  # type: ignore[attr-defined]
BOUNDED = settings(
    max_examples=amount(15, 60), deadline=None, derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)  # fmt: skip


def run(words: list[str], files: dict[str, bytes]) -> tuple[int, str]:
    """Run a command in a folder with these files and check what holds for every outcome."""
    here = Path.cwd()
    out, err = io.StringIO(), io.StringIO()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            for name, content in files.items():
                Path(name).write_bytes(content)
            with redirect_stdout(out), redirect_stderr(err), pytest.raises(SystemExit) as left:
                main(words)
            status = int(left.value.code or 0)
            said = err.getvalue()
            assert status in (0, 1, 2), f"{words}: {said}"
            assert "Traceback" not in said
            present = {path.name: path.read_bytes() for path in Path().iterdir() if path.is_file()}
        finally:
            os.chdir(here)
    if status == 2:
        assert out.getvalue() == "", words
        assert present == files, f"{words} left {sorted(present)}"
        lines = [line for line in said.splitlines() if not line.startswith("pmsm-ctrl: some.csv: ")]
        assert len(lines) <= 1, said
        assert len(said) < 6000
    assert not any(name.endswith(".part") for name in present)
    return status, said


WORDS = st.sampled_from([
    "some.toml", "some.csv", "none.csv", "none.toml", ".", "..", "/", "/dev/null/x", "", "-", "--", "-1", "0", "1e999",
    "nan", "st", "c", "x", "cogging", "coulom", "identification", "sweep", "a=b", "omega=#2 [rpm]", "t=every 1 ms",
    "speed_max=1e300", "duration=-1", "duration=nan", "=", "🙂", "a" * 300, "\n", "--help-me", "%s", "{0}",
])  # fmt: skip


@st.composite
def lines(draw: st.DrawFn) -> list[str]:
    """Return a command with some of its own options and any words."""
    name = draw(st.sampled_from(sorted(COMMANDS)))
    words = [name, *draw(st.lists(WORDS, max_size=2))]
    options = sorted(option for p in COMMANDS[name].params for option in p.opts if option.startswith("-"))
    for option in draw(st.lists(st.sampled_from([*options, "--nonsense"]), max_size=4)):
        words.append(option)
        if option != "--help" and draw(st.booleans()):
            words.append(draw(WORDS))
    return words


@settings(BOUNDED, max_examples=amount(12, 100))
@given(lines())
def test_any_words(words: list[str]) -> None:
    run(words, {"some.toml": b"[motor]\nJ = 1\n", "some.csv": b"t,x\n1,2\n"})


@st.composite
def damaged(draw: st.DrawFn, good: bytes) -> bytes:
    """Cut, flip, repeat or replace pieces of a good file."""
    content = bytearray(good)
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.integers(0, max(0, len(content) - 1)))
        size = draw(st.integers(0, 30))
        how = draw(st.sampled_from(["cut", "flip", "drop", "repeat", "insert"]))
        if how == "cut":
            del content[at:]
        elif how == "flip" and content:
            content[at] ^= draw(st.integers(1, 255))
        elif how == "drop":
            del content[at : at + size]
        elif how == "repeat":
            content[at:at] = content[at : at + size]
        else:
            content[at:at] = draw(st.binary(max_size=8))
    return bytes(content)


ON_LOGS = [
    ["import", "some.csv", "--output", "out.csv", "--json", "out.json"],
    ["identify", "some.csv", "--design", "some.toml", "--output", "new.toml", "--json", "out.json"],
    ["compare", "some.csv", "--design", "some.toml", "--json", "out.json"],
    ["track", "some.csv", "--design", "some.toml", "--json", "out.json"],
    ["diagnose", "some.csv", "--design", "some.toml", "--output", "new.toml"],
    ["add", "cogging", "--log", "some.csv", "--design", "some.toml", "--output", "new.toml"],
]


@BOUNDED
@given(st.sampled_from(ON_LOGS), damaged(LOG))
def test_any_damaged_log(words: list[str], log: bytes) -> None:
    status, said = run(words, {"some.toml": DESIGN, "some.csv": log})
    if status == 2:
        assert "some.csv" in said


@settings(BOUNDED, max_examples=amount(5, 80))
@given(st.sampled_from([["export", "some.toml", "--language", "st", "--output", "out.st"],
                        ["effects", "coulomb", "--design", "some.toml"],
                        ["simulate", "some.toml", "--set", "duration=0.01", "--scenario", "hold", "--output", "l.csv"],
                        ["import", "some.csv", "--design", "some.toml", "--output", "out.csv"]]),
       damaged(DESIGN))  # fmt: skip
def test_any_damaged_design(words: list[str], design: bytes) -> None:
    status, said = run(words, {"some.toml": design, "some.csv": LOG})
    if status == 2:
        assert re.search(r"some\.(toml|csv)|scenario|simulation", said), said


numbers = st.floats(allow_nan=True, allow_infinity=True) | st.integers(-(10**20), 10**20)
VALUES = numbers.map(repr) | st.sampled_from(["true", "'text'", "[]", "[1, 2]", "{}", "1979-05-27", "''", "0x10"])
FIELDS = [
    line.split("=")[0].strip() for line in DESIGN.decode().splitlines() if "=" in line and not line.startswith("#")
]


@settings(BOUNDED, max_examples=amount(12, 80))
@given(st.sampled_from(FIELDS), VALUES, st.sampled_from(["export", "import", "simulate"]))
@pytest.mark.slow
def test_any_value_of_any_field(field: str, value: str, verb: str) -> None:
    text = re.sub(rf"^{field}\s*=.*$", f"{field} = {value}", DESIGN.decode(), count=1, flags=re.MULTILINE)
    words = {
        "export": ["export", "some.toml", "--language", "c", "--output", "out.c"],
        "import": ["import", "some.csv", "--design", "some.toml"],
        "simulate": ["simulate", "some.toml", "--scenario", "hold", "--set", "duration=0.01", "--output", "l.csv"],
    }[verb]
    status, said = run(words, {"some.toml": text.encode(), "some.csv": LOG})
    if status == 2:
        assert re.search(r"some\.toml|scenario|simulation", said), said


@settings(BOUNDED, max_examples=amount(3, 60))
@given(st.sampled_from(["sweep", "identification", "chirp", "hold", "reversal", "positioning", "trapezoid", "warm_up"]),
       st.lists(st.tuples(st.sampled_from(["duration", "speed_max", "speed_step", "dwell", "acceleration", "amplitude",
                                           "frequency", "f_stop", "speed"]), numbers), max_size=3))  # fmt: skip
def test_any_parameter_of_a_motion(scenario: str, given_values: list[tuple[str, float]]) -> None:
    words = ["simulate", "some.toml", "--scenario", scenario, "--output", "log.csv"]
    for name, value in given_values:
        words += ["--set", f"{name}={value!r}"]
    run(words, {"some.toml": DESIGN})
