"""Beckhoff's ADS through pyads: a stand-in sends recorded samples, and the tracking is that of the same lines."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.cli import main
from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.track import watch
from pmsm_ctrl.track.ads import Address, ads_lines, parse_address
from pmsm_ctrl.track.stream import IDLE, REOPENED
from tests.unit.track.ads_server import CONFIG, StandIn

# a loopback address of its own for each process: the port is fixed
HOST = f"127.{1 + os.getpid() // 65536 % 250}.{os.getpid() // 256 % 256}.{1 + os.getpid() % 250}"
SOURCE = f"ads://{HOST}/5.12.82.20.1.1:851"
SYMBOLS = ("MAIN.axis[1].speed", "GVL.current")
MAPPING = {"omega": "MAIN.axis[1].speed [rpm]", "i_q": "GVL.current [A]"}
RPM = np.pi / 30.0

Samples = Sequence[tuple[float, Sequence[float]]]


PATIENCE = 60.0  # s, in which a stand-in has sent what a test waits for


@pytest.fixture
def serve() -> Iterator[Callable[..., StandIn]]:
    pytest.importorskip("pyads")
    running: list[StandIn] = []

    def start(samples: Samples, **more: int) -> StandIn:
        running.append(StandIn(HOST, SYMBOLS, samples, **more))
        running[-1].start()
        return running[-1]

    yield start
    for one in running:
        one.close()


def samples(count: int) -> list[tuple[float, tuple[float, float]]]:
    """Return a triangle of speed, rpm, with the current of F_c = 0.02 N m and of the reference motor's inertia."""
    t = 1e-3 * np.arange(count)
    phase = (t / 0.5) % 1.0
    omega = 400.0 * np.abs(phase - 0.5) - 100.0
    torque = 9e-5 * np.where(phase < 0.5, -800.0, 800.0) + 0.02 * np.sign(omega) + 1.68e-4 * omega
    return [(float(a), (float(b), float(c))) for a, b, c in zip(t, omega / RPM, torque / 1.032, strict=True)]


def collected(lines: Iterator[str], count: int) -> list[str]:
    """Return so many lines that are samples, with what stands between them but idleness."""
    out: list[str] = []
    begun = time.monotonic()
    while sum(line != REOPENED for line in out) < count:
        out += [line for line in islice(lines, 1) if line != IDLE]
        assert time.monotonic() - begun < PATIENCE, f"{len(out)} of {count} lines in {PATIENCE:g} s"
    return out


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("ads://5.12.82.20.1.1", Address("", "5.12.82.20.1.1", 851)),
        ("ads://plc.local/5.12.82.20.1.1:852", Address("plc.local", "5.12.82.20.1.1", 852)),
    ],
)
def test_addresses(text: str, found: Address) -> None:
    assert parse_address(text) == found


@pytest.mark.parametrize("text", ["ads://", "ads://5.12.82.20", "ads://5.12.82.20.1.300", "ads://h/5.1.1.1.1.1:x"])
def test_what_is_no_address_is_refused(text: str) -> None:
    with pytest.raises(RequestError, match="NETID"):
        parse_address(text)


def test_every_sample_arrives_with_its_time_stamp_and_a_lost_connection_is_opened_again(
    serve: Callable[..., StandIn],
) -> None:
    sent = samples(220)
    serve(sent, cut=120)
    lines = ads_lines(SOURCE, MAPPING, poll=0.01, retry=0.05)
    assert next(lines) == "t [s]\tMAIN.axis[1].speed [rpm]\tGVL.current [A]"
    found = collected(lines, 220)
    lines.close()
    assert found[120] == REOPENED
    del found[120]
    values = np.array([line.split("\t") for line in found], dtype=float)
    np.testing.assert_allclose(values[:, 0], [t for t, _ in sent], atol=1e-7)
    np.testing.assert_array_equal(values[:, 1:], [row for _, row in sent])


@pytest.mark.slow
def test_friction_is_tracked_from_the_plc(serve: Callable[..., StandIn], designs: Path) -> None:
    serve(samples(2000))
    lines = ads_lines(SOURCE, MAPPING, poll=0.01)
    design = Design.read(designs / "seed_motor.toml")
    found = watch(design, islice(lines, 2001), mapping=MAPPING, estimate=())
    lines.close()
    assert found.samples + found.damaged <= 2000
    assert (found.lost, found.repeated, found.jumps) == (0, 0, 0)
    assert found.estimates["F_c"].value == pytest.approx(0.02, rel=0.05)


@pytest.mark.parametrize(
    ("state", "mapping", "said"),
    [
        (5, {**MAPPING, "i_q": "GVL.absent [A]"}, "symbol GVL.absent: .*not found"),
        (CONFIG, MAPPING, "not in RUN"),
    ],
)
def test_what_the_plc_does_not_have_is_said(
    serve: Callable[..., StandIn], state: int, mapping: dict[str, str], said: str
) -> None:
    serve(samples(1), state=state)
    with pytest.raises(RequestError, match=said):
        list(islice(ads_lines(SOURCE, mapping), 2))


def test_the_command_needs_pyads_and_the_symbols(
    designs: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["track", "--live", SOURCE, "--design", str(designs / "seed_motor.toml")]
    if "pyads" in sys.modules:
        with pytest.raises(SystemExit) as left:
            main(words)
        assert left.value.code == 2
        assert "--map CHANNEL='SYMBOL [UNIT]' was expected" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "pyads", None)
    with pytest.raises(SystemExit) as left:
        main(words)
    assert left.value.code == 2
    assert "pip install 'pmsm-ctrl[ads]'" in capsys.readouterr().err
