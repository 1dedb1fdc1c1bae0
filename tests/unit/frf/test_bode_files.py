"""Measured Bode diagrams in the layouts of drives and analysers: the axis of a closed form is found in all of them."""

import math

import control as ct
import numpy as np
import pytest

from pmsm_ctrl import Design, frf
from pmsm_ctrl.cli import app
from pmsm_ctrl.console import run
from pmsm_ctrl.errors import LogError, RequestError
from pmsm_ctrl.frf import is_bode_file, read_response
from pmsm_ctrl.frf.from_bode import unit_names
from pmsm_ctrl.tune.linearise import default_speed
from pmsm_ctrl.tune.margins import response
from pmsm_ctrl.tune.sampled import Cascade, filters, pi

J_MOTOR, J_LOAD, K, D = 5e-5, 4e-5, 15.0, 0.002
RESONANCE = math.sqrt(K * (1.0 / J_LOAD + 1.0 / J_MOTOR)) / (2.0 * math.pi)
FREQUENCY = np.geomspace(5.0, 400.0, 160)
SPRING = {"J_load": J_LOAD, "k": K, "d": D}


@pytest.fixture(scope="module")
def seed(designs):
    """The reference motor, believed rigid."""
    return Design.read(designs / "seed_motor.toml")


@pytest.fixture(scope="module")
def axis():
    """Response from torque to speed of two masses, by python-control, with noise of 0.5 %."""
    s = ct.tf("s")
    spring = D * s + K
    exact = (J_LOAD * s**2 + spring) / (J_MOTOR * J_LOAD * s**3 + (J_MOTOR + J_LOAD) * s * spring)
    values = exact(2j * math.pi * FREQUENCY)
    rng = np.random.default_rng(11)
    noise = rng.standard_normal((2, len(values)))
    return values * (1.0 + 0.005 / math.sqrt(2.0) * (noise[0] + 1j * noise[1]))


def lines(header, *columns, separator=",", decimal="."):
    rows = [separator.join(f"{value:.6g}".replace(".", decimal) for value in row) for row in zip(*columns, strict=True)]
    return "\n".join([*header, *rows]) + "\n"


def db(values):
    return 20.0 * np.log10(np.abs(values))


def deg(values):
    return np.degrees(np.unwrap(np.angle(values)))


def wrapped(values):
    return np.degrees(np.angle(values))


def files(P, K_t):
    """Return texts by layout, each with whether anything is left in doubt."""
    rpm = P * K_t * 30.0 / math.pi  # rpm per A
    f, w = FREQUENCY, 2.0 * math.pi * FREQUENCY
    return {
        "comma, dB, deg": (lines(["Frequency [Hz],Magnitude [dB],Phase [deg]"], f, db(rpm), deg(rpm)), "rpm/A"),
        "semicolon, German": (
            lines(["Frequenz [Hz];Betrag [dB];Phase [Grad]"], f, db(rpm), wrapped(rpm), separator=";", decimal=","),
            "rpm/A",
        ),
        "tab, rad": (lines(["Freq (Hz)\tAmp0 (dB)\tPhase0 (rad)"], f, db(rpm), np.angle(rpm), separator="\t"), "rpm/A"),
        "linear, rad/s": (lines(["omega,Gain (abs),Phase (deg)"], w, np.abs(P), deg(P)), "(rad/s)/(N m)"),
        "complex": (lines(["f;Re;Im"], f, P.real, P.imag, separator=";"), "(rad/s)/(N m)"),
        "no header": (lines([], f, db(rpm), deg(rpm)), "rpm/A"),
        "text above and below": (
            lines(
                ["Axis 1", "Date: 2024-05-01", "Frequency [Hz];Amplitude [dB];Phase [deg]"],
                f, db(rpm), deg(rpm), separator=";",
            ) + "TIMESTAMP: 09/25/03\n",
            "rpm/A",
        ),
    }  # fmt: skip


LAYOUTS = (
    "comma, dB, deg",
    "semicolon, German",
    "tab, rad",
    "linear, rad/s",
    "complex",
    "no header",
    "text above and below",
)


@pytest.mark.parametrize(
    ("header", "unit", "sure"),
    [
        ("gain [(rad/s)/(N m)]", "(rad/s)/(N m)", True),
        ("Magnitude [rad/s/Nm]", "(rad/s)/(N m)", True),
        ("Betrag [dB re (U/min)/Nm]", "rpm/(N m)", True),
        ("Amplitude [rpm/Arms]", "rpm/A rms", True),
        ("Magnitude (dB re rpm/A)", "rpm/A", False),
        ("Magnitude [dB]", "rpm/A", False),
    ],
)
def test_a_unit_in_the_header_is_no_doubt(seed, axis, tmp_path, header, unit, sure):
    """A current in A alone may be a peak or an rms value."""
    size = np.abs(axis) / unit_names(seed)[unit]
    path = tmp_path / "bode.csv"
    shown = db(size) if "dB" in header else size
    path.write_text(lines([f"f [Hz],{header},Phase [deg]"], FREQUENCY, shown, deg(axis)), encoding="utf-8")
    given = read_response(path, seed, kind="plant")
    assert given.unit == unit
    np.testing.assert_allclose(given.plant.value, axis, rtol=2e-5)
    assert (not given.doubts) == sure


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_gives_the_same_axis(seed, axis, tmp_path, layout):
    text, unit = files(axis, seed.K_t)[layout]
    path = tmp_path / "bode.csv"
    path.write_text(text, encoding="utf-8")
    given = read_response(path, seed)
    assert given.kind == "plant"
    assert given.unit == unit
    np.testing.assert_allclose(given.plant.value, axis, rtol=2e-5)
    assert any("unit is taken as" in doubt for doubt in given.doubts)
    if layout == "complex":
        result = frf(seed, given)
        values = {name: one.value for name, one in result.estimates.items()}
        assert values["J"] == pytest.approx(J_MOTOR + J_LOAD, rel=0.01)
        assert values["resonance"] == pytest.approx(RESONANCE, rel=0.005)
        assert values["damping"] == pytest.approx(D, rel=0.2)
        assert {"frf_file_interpreted", "frf_resonance_not_in_design"} <= {one.code for one in result.notices}
        assert 0.5 < result.misfit < 2.0
        said = " ".join(result.summary().split())
        assert f"Hz; the file states no speed, the design's is that at {default_speed(seed):.3g} rad/s" in said


@pytest.mark.parametrize(("size", "angle"), [("dB", "deg"), ("dB", "rad"), ("linear", "deg"), ("linear", "rad")])
def test_units_that_are_not_stated_follow_from_slope_and_phase(seed, axis, tmp_path, size, angle):
    """All figures are above zero, so that they may be dB or not; with Bode's relation one of them fits the phase."""
    path = tmp_path / "bode.csv"
    axis = 0.8 * axis
    sizes = np.abs(axis) if size == "linear" else db(axis)
    assert 0.0 < sizes.min() < sizes.max() < 300.0
    angles = np.unwrap(np.angle(axis)) if angle == "rad" else deg(axis)
    first = "0.0;1.0;0.0\n"  # a line at rest is left out
    path.write_text("Frequency;Amplitude;Phase\n" + first + lines([], FREQUENCY, sizes, angles, separator=";"))
    given = read_response(path, seed, unit="(rad/s)/(N m)")
    np.testing.assert_allclose(given.plant.value, axis, rtol=2e-5)
    assert any(f"taken as {size}" in doubt for doubt in given.doubts)
    assert any(f"Phase: no unit is stated; taken as {angle}" in doubt for doubt in given.doubts)


def test_what_is_stated_is_no_doubt(seed, axis, tmp_path):
    text, unit = files(axis, seed.K_t)["comma, dB, deg"]
    path = tmp_path / "bode.csv"
    path.write_text(text, encoding="utf-8")
    assert read_response(path, seed, kind="plant", unit=unit).doubts == ()
    with pytest.raises(RequestError, match="unit: found 'rpm'; accepted"):
        read_response(path, seed, unit="rpm")
    with pytest.raises(RequestError, match="response: found 'speed'; accepted: plant, open, closed"):
        read_response(path, seed, kind="speed")


@pytest.mark.parametrize("kind", ["open", "closed"])
def test_a_measured_speed_loop_holds_the_axis(seed, axis, tmp_path, kind):
    """The loop of the true drive around two masses, by its sampled cascade; the design believes in a rigid axis."""
    truth = seed.with_effect("compliance", SPRING)
    cascade = Cascade.of(seed, seed.loops.current, seed.loops.speed, truth=truth, at=default_speed(seed))
    w = 2.0 * math.pi * FREQUENCY
    T = cascade.period
    loop = cascade.speed_plant * ct.ss(pi(seed.loops.speed.K_p, seed.loops.speed.T_n, T)) * filters((), T)
    values = response(loop, w)
    if kind == "closed":
        values = response(cascade.system(("omega_ref",), ("omega_hat",)), w)
    name = {"open": "Open Loop", "closed": "Closed Loop"}[kind]
    path = tmp_path / "loop.csv"
    path.write_text(
        lines(
            [f"Frequency;{name} Magnitude (dB);{name} Phase (deg)"], FREQUENCY, db(values), deg(values), separator=";"
        )
    )
    given = read_response(path, seed)
    assert given.kind == kind
    result = frf(seed, given)
    found = {name: one.value for name, one in result.estimates.items()}
    assert found["J"] == pytest.approx(J_MOTOR + J_LOAD, rel=0.02)
    assert found["resonance"] == pytest.approx(RESONANCE, rel=0.005)
    assert abs(found["delay"]) < 50e-6
    margin, believed = result.margins["phase_margin"]
    assert margin.value < believed - 1.0
    assert "speed" in result.responses


def test_of_several_sets_the_axis_is_taken_first(seed, axis, tmp_path):
    """As TwinCAT's Bode plot has them: open loop, closed loop and process beside each other."""
    loop = 0.1 * axis
    path = tmp_path / "sets.csv"
    head = ";".join(
        f"{name} {part}"
        for name in ("Open Loop", "Closed Loop", "Process")
        for part in ("Magnitude [dB]", "Phase [deg]")
    )
    columns = [part(values) for values in (loop, loop / (1.0 + loop), axis) for part in (db, deg)]
    path.write_text(lines([f"Frequency [Hz];{head}"], FREQUENCY, *columns, separator=";"), encoding="utf-8")
    given = read_response(path, seed)
    assert given.kind == "plant"
    np.testing.assert_allclose(given.plant.value, axis, rtol=2e-5)
    assert read_response(path, seed, kind="open").kind == "open"


def test_sets_of_different_lengths_are_read_to_their_ends(seed, axis, tmp_path):
    """Beside each other, each with its own frequencies: the shorter one leaves cells empty."""
    long = lines([], FREQUENCY, db(axis), wrapped(axis), separator=";").splitlines()
    short = lines([], FREQUENCY[:100], db(0.1 * axis[:100]), wrapped(axis[:100]), separator=";").splitlines()
    head = ";".join(
        f"{name} {part}"
        for name in ("Process", "Open Loop")
        for part in ("Frequency [Hz]", "Magnitude [dB]", "Phase [deg]")
    )
    for missing in (";;", ""):  # with the separators of the empty cells, and without
        rows = [f"{row};{other}" for row, other in zip(long, short + [missing] * 60, strict=True)]
        path = tmp_path / "sets.csv"
        path.write_text("\n".join([head, *rows, ""]), encoding="utf-8")
        given = read_response(path, seed)
        assert given.kind == "plant"
        np.testing.assert_allclose(given.plant.value, axis, rtol=2e-5)
        assert len(read_response(path, seed, kind="open").measured) == 100


def test_separators_at_the_end_and_blank_lines_are_no_data(seed, axis, tmp_path):
    path = tmp_path / "bode.csv"
    rows = lines(["Frequency [Hz];Magnitude [dB];Phase [deg]"], FREQUENCY, db(axis), deg(axis), separator=";")
    first, last = rows.splitlines()[:50], rows.splitlines()[50:]
    path.write_text("\n".join([*(f"{row};" for row in first), "", *(f"{row};" for row in last), ""]))
    np.testing.assert_allclose(read_response(path, seed, unit="(rad/s)/(N m)").plant.value, axis, rtol=2e-5)


def test_rows_below_a_text_are_left_out_and_said(seed, axis, tmp_path):
    path = tmp_path / "bode.csv"
    rows = lines(["Frequency [Hz],Magnitude [dB],Phase [deg]"], FREQUENCY, db(axis), deg(axis))
    path.write_text(f"{rows}second recording\n{rows}")
    given = read_response(path, seed)
    assert len(given.plant) == len(FREQUENCY)
    assert "line 162 is no row of numbers; 160 rows below it are left out" in given.doubts


def test_the_command_asks_before_it_takes_a_doubt(seed, axis, designs, tmp_path, capsys):
    path, design = tmp_path / "bode.csv", designs / "seed_motor.toml"
    path.write_text(files(axis, seed.K_t)["comma, dB, deg"][0], encoding="utf-8")
    assert run(app, ["frf", str(path), "--design", str(design)]) == 2
    error = capsys.readouterr().err
    assert "the unit is taken as rpm/A, with which the inertia is" in error
    assert "--response plant --unit rpm/A --yes" in error
    written = tmp_path / "measured.toml"
    assert run(app, ["frf", str(path), "--design", str(design), "--yes", "--output", str(written)]) == 0
    assert Design.read(written).parameters("compliance")["k"] == pytest.approx(K, rel=0.02)
    assert run(app, ["frf", str(path), "--design", str(design), "--response", "plant", "--unit", "rpm/A"]) == 0


def test_what_is_no_bode_diagram_is_said(seed, tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t [s],omega [rad/s],i_q [A]\n" + "".join(f"{0.001 * k},1.0,0.1\n" for k in range(50)))
    assert not is_bode_file(path)
    with pytest.raises(LogError, match="no column of frequencies"):
        read_response(path, seed)
    path.write_text("Frequency,Magnitude [dB]\n" + "".join(f"{k + 1},1.0\n" for k in range(50)))
    with pytest.raises(LogError, match="neither magnitude and phase nor real and imaginary part"):
        read_response(path, seed)
    path.write_text("Frequency,Magnitude [dB],Phase [deg]\n" + "".join(f"{k + 1},1.0,2.0\n" for k in range(5)))
    assert is_bode_file(path)
    with pytest.raises(LogError, match="5 frequencies; at least 12"):
        read_response(path, seed)
