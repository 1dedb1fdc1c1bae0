"""Text files as drives and scopes write them. Every file is made here; the layouts are those of real exports."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers import describe, open_table, propose, read_log
from pmsm_ctrl.importers.names import unit_of

RPM = 0.10471975511965977


def scope(
    separator: str = "\t",
    decimal: str = ".",
    end: str = "EOF\n",
    full_time: bool = False,
    metadata: bool = True,
    fast: int = 40,
) -> str:
    """A TwinCAT Scope export: one channel at 0.5 ms, then two that share a time column of 1 ms, fewer rows of them."""
    head = [
        ["Name", "axis 1"],
        ["File", "C:\\scope\\axis 1.csv"],
        ["Starttime of export", "132959733843760000", "Montag, 2. Mai 2022", "15:56:24.376"],
        ["Endtime of export", "132959733853750000", "Montag, 2. Mai 2022", "15:56:25.375"],
        [],
        [],
        ["Name", "ActPos", "Name", "ActVelo", "ActTorque"],
    ]
    if metadata:
        head += [
            ["SymbolComment", "", "SymbolComment"],
            ["Data-Type", "REAL64", "Data-Type", "REAL64", "INT16"],
            ["SampleTime[ms]", "0,5", "SampleTime[ms]", "1", "1"],
            ["SymbolName", "MAIN.fPos", "SymbolName", "MAIN.fVelo", "MAIN.nTorque"],
            ["Offset", "0", "Offset", "0", "0"],
            ["ScaleFactor", "1", "ScaleFactor", "1", "0,001"],
            ["Unit", "° (Angle)", "Unit", "rpm (Velocity)", "(None)"],
            ["Unit ScaleFactor", "1", "Unit ScaleFactor", "1", "1"],
        ]
    head.append([])

    def number(value: float) -> str:
        return repr(value).replace(".", decimal)

    def time(milliseconds: float) -> str:
        return str(132959733843760000 + round(milliseconds * 10000)) if full_time else number(milliseconds)

    rows = []
    for k in range(fast):
        row = [time(0.5 * k), number(0.25 * k)]
        if k < fast // 2:
            row += [time(1.0 * k), number(10.0 * k), number(0.5 + k)]
        else:
            row += ["", "", ""]
        rows.append(row)
    return "".join(separator.join(row) + "\n" for row in [*head, *rows]) + end


def write(tmp_path: Path, text: str, encoding: str = "utf-8-sig") -> Path:
    path = tmp_path / "scope.csv"
    path.write_bytes(text.encode(encoding))
    return path


@pytest.mark.parametrize(("separator", "decimal"), [("\t", "."), ("\t", ","), (";", "."), (";", ","), (",", ".")])
@pytest.mark.parametrize("end", ["EOF\n", "EOF", ""])
def test_twincat_scope(tmp_path: Path, separator: str, decimal: str, end: str) -> None:
    text = scope(separator, decimal, end)
    if separator == ",":
        text = (
            text.replace("Montag, 2", "Montag 2")
            .replace("0,5\t", "0.5\t")
            .replace("0,5,", "0.5,")
            .replace("0,001", "0.001")
        )
    log = read_log(write(tmp_path, text))
    assert log.provenance.importer == "TwinCAT Scope CSV"
    # the position's raster is kept; 40 samples of 0.5 ms, of which those inside the other group's 0..19 ms remain
    np.testing.assert_allclose(log.t, 0.0005 * np.arange(39), atol=1e-15)
    np.testing.assert_allclose(log["theta"], np.deg2rad(0.25) * np.arange(39), rtol=1e-14)
    np.testing.assert_allclose(log["omega"], 10.0 * RPM * np.arange(39) / 2, rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(log["torque"], 0.5 + np.arange(39) / 2, rtol=1e-14)
    notes = " | ".join(log.provenance.notes)
    assert "omega, torque interpolated linearly from a raster of 1 ms to 0.5 ms" in notes
    assert "1 samples outside" in notes
    assert "'ActTorque' has ScaleFactor 0" in notes
    assert "taken as applied already" in notes


def test_twincat_scope_in_one_time_column_for_each_group(tmp_path: Path) -> None:
    log = read_log(write(tmp_path, scope(full_time=True)))
    assert np.diff(log.t) == pytest.approx(0.0005, abs=4e-6)  # a double holds a FILETIME to 1.6 us
    assert len(log) == 39


def test_twincat_scope_with_names_only(tmp_path: Path) -> None:
    log = read_log(write(tmp_path, scope(",", metadata=False).replace("Montag, 2", "Montag 2")))
    assert log.provenance.importer == "TwinCAT Scope CSV"
    assert log["theta"][4] == 1.0


def test_twincat_scope_without_numbers(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="line 7: a TwinCAT Scope header without rows of numbers"):
        read_log(write(tmp_path, scope(fast=0)))


def test_twincat_scope_names_the_place_of_a_bad_cell(tmp_path: Path) -> None:
    text = scope().replace("\t30.0\t", "\tx30\t")
    with pytest.raises(LogError, match=r"line 20, column 4 \('ActVelo'\): 'x30' found"):
        read_log(write(tmp_path, text))
    with pytest.raises(LogError, match=r"line 20, column 4 \('ActVelo'\): empty"):
        read_log(write(tmp_path, scope().replace("\t30.0\t", "\t\t")))


def test_siemens_trace(tmp_path: Path) -> None:
    """Quoted names, a row of units, semicolons and decimal commas."""
    text = (
        '"Trace";"Achse_1"\n"Zeitstempel";"02.05.2022 15:56:24"\n"Abtastung";"0,125 ms"\n\n'
        '"Zeit";"Drehzahlistwert";"Momentistwert";"Drehzahlsollwert"\n"ms";"1/min";"Nm";"1/min"\n'
        + "".join(f"{0.125 * k:.3f};{100 + k}.5;{0.01 * k:.2f};100.0\n".replace(".", ",") for k in range(20))
    )
    log = read_log(write(tmp_path, text, "latin-1"))
    assert list(log) == ["t", "omega_ref", "omega", "torque"]
    np.testing.assert_allclose(log.t, 0.125e-3 * np.arange(20), rtol=1e-12)
    assert log["omega"][3] == pytest.approx(103.5 * RPM)
    assert log["torque"][3] == pytest.approx(0.03)
    assert "3 lines above the numbers not used" in log.provenance.notes


def test_br_trace(tmp_path: Path) -> None:
    """Metadata, then a header with path names and a row of data types."""
    text = (
        "Trace,AxisTrace\nSampling time,0.0004\n"
        "Time [s],gAxis01.ActPosition [°],gAxis01.ActSpeed [°/s],gAxis01.Iq [A]\n"
        "TIME,LREAL,REAL,REAL\n"
        + "".join(f"{0.0004 * k:.4f},{0.9 * k:.1f},{2250 + k},{0.1 * k:.1f}\n" for k in range(20))
    )
    log = read_log(write(tmp_path, text))
    assert list(log) == ["t", "theta", "omega", "i_q"]
    assert log["theta"][10] == pytest.approx(math.radians(9.0))
    assert log["omega"][0] == pytest.approx(math.radians(2250))


def test_repeated_time_columns_of_unequal_length(tmp_path: Path) -> None:
    rows = [
        f"{k},0;{0.1 * k:.1f};".replace(".", ",") + (f"{2 * k},0;{k},5" if k < 10 else ";") + "\n" for k in range(25)
    ]
    log = read_log(write(tmp_path, "Time [ms];Position;Time [ms];Iq\n" + "".join(rows)))
    assert log.provenance.importer == "CSV with repeated time columns"
    np.testing.assert_allclose(log.t, 1e-3 * np.arange(19))
    np.testing.assert_allclose(log["i_q"], 0.5 + 0.5 * np.arange(19))


def padded(tmp_path: Path, current: int) -> Path:
    """Write 40 rows of a speed, 20 of a position with a time of its own, and a current of so many behind it."""
    rows = [
        f"{k},{k % 7}," + (f"{2 * k},{0.1 * k:.1f}," if k < 20 else ",,") + (f"{k}.5\n" if k < current else "\n")
        for k in range(40)
    ]
    return write(tmp_path, "Time [ms],Speed [rpm],Time pos [ms],Position [rad],Iq [A]\n" + "".join(rows))


def test_a_column_that_is_longer_than_the_time_before_it(tmp_path: Path) -> None:
    log = read_log(padded(tmp_path, 40))
    np.testing.assert_allclose(log["i_q"], 1e3 * log.t + 0.5)
    assert "'Iq [A]' read with the time 'Time [ms]', which has as many rows" in " | ".join(log.provenance.notes)


def test_numbers_without_a_time(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"line 22, column 5 \('Iq \[A\]'\): 10 numbers without a time"):
        read_log(padded(tmp_path, 30))


@pytest.mark.parametrize("names", [("Time Speed [ms]", "Time Current [ms]"), ("Zeit 1 [ms]", "Zeit 2 [ms]")])
def test_a_second_time_column_of_another_name(tmp_path: Path, names: tuple[str, str]) -> None:
    rows = [f"{k};{math.sin(0.1 * k):.6f};{2 * k + 5};{2 * k + 5}\n" for k in range(40)]
    path = write(tmp_path, f"{names[0]};Position [rad];{names[1]};Iq [A]\n" + "".join(rows))
    proposal = propose(open_table(path))
    assert (names[1], "the time of the columns that follow it") in proposal.unused
    log = read_log(path, mapping=proposal.mapping)
    np.testing.assert_allclose(log["i_q"], 1e3 * log.t)
    assert log["theta"][0] == pytest.approx(math.sin(0.5), abs=1e-6)
    said = describe(path, mapping=proposal.mapping).summary(width=1000)
    assert "Notes: i_q interpolated linearly from a raster of 2 ms to 1 ms; 5 samples outside the time" in said


@pytest.mark.parametrize("last", ["Time to target [ms]", "Time limit [ms]"])
def test_what_is_no_second_time(tmp_path: Path, last: str) -> None:
    rows = [f"{k},{0.1 * k:.1f},{k % 7},{k}\n" for k in range(25)]
    table = open_table(write(tmp_path, f"Time [ms],Position [rad],{last},Iq [A]\n" + "".join(rows)))
    assert {column.group for column in table.columns} == {0}  # it does not increase
    table = open_table(write(tmp_path, f"Time [ms],Position [rad],Iq [A],{last}\n" + "".join(rows)))
    assert {column.group for column in table.columns} == {0}  # nothing follows


def test_a_column_of_text_is_among_those_that_are_not_used(tmp_path: Path) -> None:
    rows = [f"{k},{0.1 * k:.1f},0x12F,{k}\n" for k in range(25)]
    path = write(tmp_path, "Time [ms],Position [rad],Status,Iq [A]\n" + "".join(rows))
    assert propose(open_table(path)).unused == (("Status", "text"),)


@pytest.mark.parametrize(
    ("unit", "si"),
    [("tr/min", RPM), ("giri/min", RPM), ("vueltas/min", RPM), ("mrad/s", 1e-3), ("tr/s", 2 * math.pi)],
)
def test_units_of_a_speed(unit: str, si: float) -> None:
    assert unit_of(unit) == ("rad/s", pytest.approx(si))


def test_units_of_milliamperes_and_milliradians() -> None:
    assert unit_of("mA rms") == unit_of("mA eff") == ("A", pytest.approx(1e-3 * math.sqrt(2)))
    assert unit_of("mrad") == ("rad", 1e-3)


def test_a_unit_that_is_not_known_is_named(tmp_path: Path) -> None:
    rows = [f"{k},{0.1 * k:.1f},{100 + k % 3},{k}\n" for k in range(25)]
    path = write(tmp_path, "Time [ms],Position [rad],Speed Actual [1/s],Iq [A]\n" + "".join(rows))
    said = "unit \"1/s\" is not known; --map omega='Speed Actual [rpm]' states one that is"
    assert propose(open_table(path)).unused == (("Speed Actual [1/s]", said),)
    assert f"Speed Actual [1/s]: {said}" in describe(path).remarks
    assert "omega" in read_log(path, mapping={"omega": "Speed Actual [rpm]"})
    path = write(tmp_path, "Time [ms],Pos [foo],Speed Actual [1/s],Iq [A]\n" + "".join(rows))
    with pytest.raises(LogError, match='unit "foo" is not known'):
        read_log(path)


def test_groups_that_do_not_overlap(tmp_path: Path) -> None:
    rows = [f"{k};{k};{k + 100};{k}\n" for k in range(10)]
    with pytest.raises(LogError, match=r"scope.csv: the channel groups do not overlap in time"):
        read_log(write(tmp_path, "Time;Position;Time;Iq\n" + "".join(rows)))


def test_decimal_comma_and_point_in_one_file(tmp_path: Path) -> None:
    text = "t [s];theta [rad];i_q [A]\n0,5;0.25;1\n0,75;1,5;2.5\n1;2;3\n"
    log = read_log(write(tmp_path, text))
    assert log.t.tolist() == [0.5, 0.75, 1.0]
    assert log["theta"].tolist() == [0.25, 1.5, 2.0]
    with pytest.raises(LogError, match=r"line 3, column 2 .*'1,500.5' found"):
        read_log(write(tmp_path, text.replace("1,5;", "1,500.5;")))


def test_quoted_decimal_commas_between_commas(tmp_path: Path) -> None:
    text = 't [s],theta [rad],i_q [A]\n"0,5","0,25","1"\n"0,75","1,5","2,5"\n'
    log = read_log(write(tmp_path, text))
    assert log["i_q"].tolist() == [1.0, 2.5]


@pytest.mark.parametrize("separator", [" ", "   ", "\t", "|", ", ", " ; "])
def test_separators(tmp_path: Path, separator: str) -> None:
    text = separator.join(["Time", "Position", "Iq"]) + "\n"
    text += "".join(separator.join([f"{0.5 * k}", f"{k}", f"-{k}e-1"]) + "\n" for k in range(6))
    log = read_log(write(tmp_path, text))
    assert log["i_q"].tolist() == [-k / 10 for k in range(6)]


@pytest.mark.parametrize(
    ("stated", "own", "decimal"), [(";", ",", "."), (",", ";", ","), ("\t", ";", "."), ("|", " ", ".")]
)
def test_a_separator_of_the_design_that_does_not_fit_is_named(
    tmp_path: Path, stated: str, own: str, decimal: str
) -> None:
    rows = [[f"{0.5 * k}", f"{k}.0", f"-{k}.25"] for k in range(9)]
    lines = [own.join(["Time", "Position", "Iq"]), *(own.join(row).replace(".", decimal) for row in rows)]
    (tmp_path / "log.csv").write_text("\n".join(["Trace export", *lines]) + "\n")
    log = {"separator": stated, "decimal": ","}
    design = Design.from_dict({"name": "axis", "motor": {"J": 1e-4, "K_t": 1.0}, "log": log})
    mark = "comma" if decimal == "," else "point"
    with pytest.raises(LogError) as caught:
        open_table(tmp_path / "log.csv", design)
    assert f"the separator {stated!r} that [log] of the design states" in str(caught.value)
    assert f"the file has {own!r}, and a decimal {mark}: correct" in str(caught.value)


def test_trailing_separators(tmp_path: Path) -> None:
    log = read_log(write(tmp_path, "Time;Position;Iq;\n0;1;2;\n1;2;3;\n2;2;3;\n"))
    assert log["i_q"].tolist() == [2.0, 3.0, 3.0]
