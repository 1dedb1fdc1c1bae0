"""The five steps through the requests of a page: design, logs, compare, add, take away."""

from __future__ import annotations

import ast
import json
import struct
import tomllib
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl import Design
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.workbench import own
from pmsm_ctrl.workbench.desk import Desk
from pmsm_ctrl.workbench.session import Sessions, unlike
from pmsm_ctrl.workbench.workers import Workers
from tests.unit.workbench.harness import DESIGN, TOKEN, Bench, Page, thread

NAME = "<script>alert(1)</script>"


def unpacked(body: bytes) -> dict[str, Any]:
    """Read columns as the page does."""
    length = struct.unpack("<I", body[:4])[0]
    head, place, out = json.loads(body[4 : 4 + length]), 4 + length, {}
    for name, count in head["columns"].items():
        out[name] = np.frombuffer(body, "<f8", count, place)
        place += 8 * count
    return out


def design_in(script: str) -> str:
    """Return what the script holds as its design."""
    names: dict[str, Any] = {}
    assignment = next(one for one in ast.parse(script).body if isinstance(one, ast.Assign))
    exec(compile(ast.Module([assignment], []), "script", "exec"), names)
    return str(names["DESIGN"])


def loaded(page: Page, files: dict[str, bytes]) -> dict[str, Any]:
    assert page.post("design", {"toml": DESIGN, "name": "d.toml"}).status_code == 200
    for name, content in files.items():
        assert page.put(name, content).status_code == 200
    return page.idle()


def test_the_steps_from_the_design_to_the_files(page: Page, bench: Bench, files: dict[str, bytes]) -> None:
    state = loaded(page, files)
    assert [entry["role"] for entry in state["logs"]] == ["fit", "holdout"]
    assert [one["channel"] for one in state["logs"][0]["info"]["channels"]] == ["t", "theta", "omega", "i_q"]
    page.post("steps", {"begin": True})
    model = page.idle()["model"]
    assert [one["name"] for one in model["models"]] == ["base parameters"]
    # the hidden drag, k = 4e-6 N m s^2/rad^2, or what cannot be told from it, is offered first
    assert model["candidates"][0]["id"] in ("quadratic_drag", "viscous_power")
    page.post("steps", {"add": "quadratic_drag"})
    state = page.idle()
    effect = state["model"]["effects"][-1]
    assert effect["meanings"] == ["quadratic drag coefficient"]
    assert state["model"]["alike"] == [], "only a search compares an effect with its look-alikes"
    before, after = (one["holdout"]["torque"]["relative"] for one in state["model"]["models"])
    assert after < 0.8 * before
    design = page.get("take/design").text
    drag = next(one for one in tomllib.loads(design)["effects"] if one["id"] == "quadratic_drag")
    assert drag["k_2"] == pytest.approx(4e-6, rel=0.05)
    assert Design.from_toml(design).name == NAME
    assert page.get("take/json").json()["effects"] == ["quadratic_drag"]
    report = page.get("take/report")
    assert "&lt;script&gt;alert(1)" in report.text
    assert NAME not in report.text
    assert 'data-part="quadratic_drag"' in report.text  # its switch
    assert report.headers["content-disposition"] == 'attachment; filename="script_alert_1_script.html"'
    script = page.get("take/script").text
    assert "model = model.add('quadratic_drag')" in script
    ast.parse(script)
    assert tomllib.loads(design_in(script)) == tomllib.loads(state["design"]["toml"])
    page.post("steps", {"remove": "quadratic_drag"})
    assert page.idle()["model"]["names"] == []
    page.post("steps", {"undo": True})
    assert page.idle()["model"]["names"] == ["quadratic_drag"]
    # a restart: another server on the same folder
    with Bench(bench.folder).client() as client:
        again = Page(client, page.base)
        assert again.get("state").json()["model"]["names"] == ["quadratic_drag"]
        assert again.get("take/design").text == design
        assert [one["name"] for one in again.get("about").json()["sessions"]] == [NAME]


def test_a_view_has_the_extremes_of_its_stretch(page: Page, files: dict[str, bytes]) -> None:
    state = loaded(page, files)
    whole = unpacked(page.get("view/log", params={"log": "log1", "channels": "omega", "bins": "50"}).content)
    assert len(whole["t"]) <= 102
    low, high = (state["logs"][0]["info"]["channels"][2][end] for end in ("low", "high"))
    assert whole["omega"].min() == pytest.approx(low, rel=1e-6)
    assert whole["omega"].max() == pytest.approx(high, rel=1e-6)
    near = unpacked(
        page.get("view/log", params={"log": "log1", "channels": "omega", "start": "3", "stop": "3.1"}).content
    )
    assert near["t"][0] >= 2.99
    assert near["t"][-1] <= 3.11
    assert page.get("view/log", params={"log": "log1", "channels": "x"}).status_code == 400
    assert page.get("view/log", params={"log": "log1", "channels": "omega", "start": "nan"}).status_code == 400


@pytest.mark.slow
def test_switching_an_effect_off_and_looking_at_a_candidate(page: Page, files: dict[str, bytes]) -> None:
    loaded(page, files)
    page.post("steps", {"begin": True})
    page.idle()
    preview = unpacked(page.get("view/preview", params={"effect": "quadratic_drag", "bins": "4000"}).content)
    before = unpacked(page.get("view/model", params={"bins": "4000"}).content)
    page.post("steps", {"add": "quadratic_drag"})
    model = page.idle()["model"]
    balance = model["records"][0]["balances"][0]
    after = unpacked(page.get("view/model", params={"bins": "4000"}).content)
    off = unpacked(page.get("view/model", params={"bins": "4000", "off": "quadratic_drag"}).content)
    # the preview is what adding took away; switched off, all of the drag is back
    taken = before["residual"] - after["residual"]
    assert np.corrcoef(taken, preview["preview"])[0, 1] > 0.9
    drag = 4e-6 * after["speed"] * np.abs(after["speed"])
    assert np.allclose(off["residual"] - after["residual"], drag, atol=0.06 * np.abs(drag).max())
    assert balance["parts"] == ["quadratic_drag"]
    error = np.sqrt(balance["products"][0][0]) / balance["size"]
    assert error == pytest.approx(model["models"][-1]["errors"]["torque"]["relative"], rel=1e-6)
    dots = unpacked(page.get("view/scatter", params={"over": "speed [rad/s]"}).content)
    assert len(dots["x"]) == len(dots["y"]) > 500
    for record in model["records"]:  # nothing repeats with the turn
        amplitude, level = np.array(record["orders"], dtype=float)
        assert len(amplitude) == len(level) > 50
        assert np.mean(amplitude[np.isfinite(amplitude)] > level[np.isfinite(amplitude)]) < 0.05
    held = unpacked(page.get("view/model", params={"record": "1", "bins": "4000"}).content)
    assert np.std(held["residual"]) < 1.5 * np.std(after["residual"])


def test_the_search_reports_and_can_be_stopped(page: Page, files: dict[str, bytes]) -> None:
    loaded(page, files)
    page.post("steps", {"begin": True})
    page.idle()
    page.post("steps", {"find": True})
    assert page.post("steps", {"add": "cogging"}).json()["error"].startswith("another step")
    page.post("stop", {})
    stopped = page.idle()
    assert "stopped" in stopped["message"]
    assert stopped["steps"] == []
    page.post("steps", {"find": True})
    found = page.idle()["model"]
    assert found["names"] == ["quadratic_drag"]
    (alike,) = found["alike"]
    assert set(alike["same"]) | set(alike["apart"])
    assert not set(alike["same"]) & set(alike["apart"])
    assert set(alike["apart"]) <= {"viscous_power", "viscous"}  # of the catalogue's look-alikes
    assert "viscous" not in alike["apart"], "it is part of the design, and no candidate"
    assert found["verdict"]["text"] == "1 missing effect: Quadratic drag"


FORM = {
    "pole_pairs": "4", "torque_constant": "1.46 N m/A rms", "resistance": "38 Ohm line", "inductance": "98.32 mH line",
    "inertia": "0.9 kg cm2", "current_limit": "3 A rms",
}  # fmt: skip


def test_an_error_stands_at_its_field(page: Page) -> None:
    wrong = FORM | {"inertia": "heavy kg cm2", "resistance": "", "encoder": "20 lines per mm", "pole_pairs": "3.5"}
    answer = page.post("design", {"machine": "motor", "name": "x", "answers": wrong})
    assert answer.status_code == 422
    assert set(answer.json()["fields"]) == {"inertia", "resistance", "encoder"}
    assert "a number with its unit was expected" in answer.json()["fields"]["inertia"]
    answer = page.post("design", {"machine": "motor", "name": "x", "answers": FORM | {"pole_pairs": "3.5"}})
    assert list(answer.json()["fields"]) == ["pole_pairs"]
    design = page.post("design", {"machine": "motor", "name": "x", "answers": FORM}).json()["design"]
    # K_t = 1.46 N m/A rms = 1.46 / sqrt(2) N m/A peak = 1.5 p psi_f
    assert tomllib.loads(design["toml"])["motor"]["psi_f"] == pytest.approx(1.46 / 2**0.5 / 6.0)
    assert any("no-load speed" in fact for fact in design["facts"])


def test_foreign_columns_are_mapped_by_hand(page: Page) -> None:
    t = np.arange(400) / 100.0
    rows = zip(t, 573.0 * np.sin(2 * t), np.sign(np.cos(2 * t)), strict=True)
    text = "alpha,beta,gamma\n" + "".join(f"{a:.4f},{b:.4f},{c:.1f}\n" for a, b, c in rows)
    page.post("design", {"toml": DESIGN})
    page.put("odd.csv", text.encode())
    info = page.idle()["logs"][0]["info"]
    assert "no channel 't'" in info["error"]
    assert "--map" not in info["error"]
    assert [column["label"] for column in info["columns"]] == ["alpha", "beta", "gamma"]
    page.post("logs/log1", {"mapping": {"t": "#1 [s]", "omega": "#2 [rpm]", "i_q": "-#3 [A rms]"}})
    info = page.idle()["logs"][0]["info"]
    assert info["error"] == ""
    speed = next(one for one in info["channels"] if one["channel"] == "omega")
    assert speed["high"] == pytest.approx(573.0 * 2 * np.pi / 60.0, rel=1e-3)
    assert page.post("logs/log1", {"mapping": {"nonsense": "#1"}}).status_code == 400
    assert page.post("logs/log1", {"window": [3.0, 1.0]}).status_code == 400


def test_a_doubt_about_a_unit_waits_for_an_answer(page: Page, files: dict[str, bytes]) -> None:
    lines = files["a.csv"].decode().splitlines()
    lines[0] = lines[0].replace("omega [rad/s]", "omega [rpm]")  # a speed that its position contradicts
    page.post("design", {"toml": DESIGN})
    page.put("a.csv", "\n".join(lines).encode())
    doubts = page.idle()["logs"][0]["info"]["doubts"]
    assert [doubt["channel"] for doubt in doubts if doubt["channel"]] == ["omega"]
    page.post("steps", {"begin": True})
    assert "choose the unit of omega" in page.idle()["message"]
    page.post("logs/log1", {"mapping": {"omega": "omega [rad/s]"}})
    assert not any(doubt["channel"] for doubt in page.idle()["logs"][0]["info"]["doubts"])


@pytest.mark.parametrize("content", [b"", b"\x00\x01\x02", b"PK\x03\x04rest", b"a,b\n1,2\n", b"\x80\x04pickle"])
def test_a_bad_file_is_a_message_at_its_log(page: Page, content: bytes) -> None:
    page.post("design", {"toml": DESIGN})
    page.put("bad.csv", content)
    state = page.idle()
    assert state["logs"][0]["info"]["error"].startswith("bad.csv")
    assert "could not be read" in page.post("steps", {"begin": True}).json()["error"]
    assert page.client.delete(f"{page.base}/logs/log1").json()["logs"] == []


def test_two_sessions_know_nothing_of_each_other(bench: Bench, files: dict[str, bytes]) -> None:
    with bench.client() as client:
        one, other = (Page(client, f"/{TOKEN}/s/{name}") for name in ("aaaaaaaaaaaa", "bbbbbbbbbbbb"))
        loaded(one, files)
        assert other.get("state").json()["design"] is None
        other.post("design", {"example": "seed_motor"})
        assert other.get("state").json()["logs"] == []
        assert one.get("state").json()["design"]["name"] == NAME


def test_a_session_is_deleted_with_its_logs(bench: Bench, page: Page, files: dict[str, bytes]) -> None:
    loaded(page, files)
    assert page.client.delete(f"{page.base}/").json()["sessions"] == []
    assert not list(bench.folder.rglob("*"))
    assert page.get("state").json()["logs"] == []


def test_logs_of_the_command_line_are_read(tmp_path: Path, bench: Bench, files: dict[str, bytes]) -> None:
    """They are copied before the server runs; the page's first look has them read."""
    from pmsm_ctrl.workbench.server import begun

    design, log = tmp_path / "d.toml", tmp_path / "a.csv"
    design.write_text(DESIGN)
    log.write_bytes(files["a.csv"])
    session = begun(bench.desk, design, [log, log, log])
    with bench.client() as client:
        logs = Page(client, f"/{TOKEN}/s/{session.id}").idle()["logs"]
    assert [entry["role"] for entry in logs] == ["fit", "holdout", "fit"]
    assert [entry["info"]["samples"] for entry in logs] == [3000, 3000, 3000]


@pytest.mark.slow
def test_a_model_of_logs_that_were_changed_meanwhile_is_dropped(page: Page, files: dict[str, bytes]) -> None:
    loaded(page, files)
    page.post("steps", {"begin": True})
    page.post("logs/log1", {"window": [2.0, 18.0]})
    state = page.idle()
    assert state["model"] is None
    assert "changed meanwhile" in state["message"]
    page.post("steps", {"begin": True})
    assert page.idle()["model"]["records"][0]["start"] >= 2.0


@pytest.mark.slow
def test_a_stopped_search_does_not_stop_the_next_process(page: Page, bench: Bench, files: dict[str, bytes]) -> None:
    loaded(page, files)
    page.post("steps", {"begin": True})
    page.idle()
    page.post("steps", {"find": True})
    page.post("stop", {})
    assert "stopped" in page.idle()["message"]
    assert not list(bench.folder.rglob("stop"))


@pytest.mark.parametrize("window", ["[-Infinity, 5]", "[0, Infinity]", "[0, NaN]", "[0, 1e999]"])
def test_a_window_is_finite(page: Page, files: dict[str, bytes], window: str) -> None:
    loaded(page, {"a.csv": files["a.csv"]})
    body = '{"window": ' + window + "}"
    assert page.client.post(f"{page.base}/logs/log1", content=body).status_code == 400
    assert page.get("state").json()["logs"][0]["window"] is None


def test_what_cannot_be_kept_does_not_spoil_the_session(tmp_path: Path) -> None:
    from pmsm_ctrl.workbench.session import Session

    session = Session(tmp_path / "abcdefghjkmn")
    with pytest.raises(ValueError, match="JSON"):
        session.changed(model={"value": float("nan")})
    session.changed(steps=[])
    assert Session(session.folder).state["model"] is None


def test_a_busy_process_does_not_make_room() -> None:
    """A search in one tab goes on while other tabs are opened."""
    import asyncio
    import threading

    from pmsm_ctrl.workbench import workers

    made, go = [], threading.Event()

    def make() -> Executor:
        made.append(ThreadPoolExecutor(1))
        return made[-1]

    async def run() -> list[object]:
        desk = workers.Workers(make)
        first = [asyncio.create_task(desk.run("0", go.wait, 30.0)) for _ in range(2)]
        await asyncio.sleep(0)
        others = [await desk.run(str(k), int) for k in range(1, workers.MOST + 2)]
        assert len(made) == workers.MOST + 2
        go.set()
        found = [*await asyncio.gather(*first), *others]
        await desk.run("9", int)
        assert len(desk._by_session) == workers.MOST
        desk.close()
        return found

    assert asyncio.run(run()) == [True, True] + [0] * (workers.MOST + 1)


def test_a_damaged_session_file_begins_anew(tmp_path: Path) -> None:
    bench = Bench(tmp_path / "s")
    (tmp_path / "s" / "abcdefghjkmn").mkdir(parents=True)
    (tmp_path / "s" / "abcdefghjkmn" / "session.json").write_text("{")
    state = bench.client().get(f"/{TOKEN}/s/abcdefghjkmn/state").json()
    assert state["design"] is None


def test_logs_of_one_name_are_told_apart() -> None:
    """The script of a session names its logs by their names."""
    assert unlike("a.csv", set()) == "a.csv"
    assert unlike("a.csv", {"a.csv", "a (2).csv"}) == "a (3).csv"
    assert unlike("log", {"log"}) == "log (2)"


def test_steps_are_bounded(tmp_path: Path) -> None:
    """Each is repeated from the one before, in calls within calls."""
    session = Sessions(tmp_path).new()
    session.changed(steps=[{"add": "cogging"}] * 100)
    with pytest.raises(RequestError, match="keeps 100 steps"):
        Desk(Sessions(tmp_path), Workers(thread)).step(session, {"add": "cogging"})


OWN = own.TEMPLATE.replace("math.sqrt(abs(omega)) * direction", "omega * abs(omega)").replace(
    "N m (s/rad)^0.5", "N m s^2/rad^2"
)


def test_an_effect_that_is_written_in_the_page(tmp_path: Path, files: dict[str, bytes]) -> None:
    """The hidden drag, as a user's own effect: offered, added, taken away in the script."""
    with Bench(tmp_path, code=True).client() as client:
        page = Page(client, f"/{TOKEN}/s/abcdefghjkmn")
        loaded(page, files)
        assert client.get(f"{page.base}/about").json()["template"] == own.TEMPLATE
        wrong = page.post("effects", {"code": "import nothing_of_that_name"}).json()
        assert "cannot be run: ModuleNotFoundError" in wrong["error"]
        shown = page.post("effects", {"code": OWN}).json()
        assert shown["own"] == [{"id": "seal_drag", "title": "Wiper seal"}]
        page.post("steps", {"begin": True})
        ranked = {one["name"] for one in page.idle()["model"]["candidates"] if one["advised"]}
        assert "seal_drag" in ranked
        page.post("steps", {"add": "seal_drag"})
        effects = {one["id"]: one for one in page.idle()["model"]["effects"]}
        assert float(effects["seal_drag"]["parameters"][0].split()[2].strip("(")) == pytest.approx(4e-6, rel=0.05)
        script = page.get("take/script").text
        assert "def seal_drag(" in script
        assert ".with_own_effects(*OWN)" in script
        names: dict[str, Any] = {"__name__": "script"}
        path = tmp_path / "steps.py"
        path.write_text(script[: script.index("fitted = [")], encoding="utf-8")
        exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), names)
        assert names["OWN"][0].id == "seal_drag"
    with Bench(tmp_path).client() as client:  # the same session, and a server that was not started for code
        page = Page(client, f"/{TOKEN}/s/abcdefghjkmn")
        assert "--allow-code" in page.post("steps", {"undo": True}).json()["error"]


def test_code_from_a_page_is_not_run(page: Page, files: dict[str, bytes], tmp_path: Path) -> None:
    loaded(page, files)
    answer = page.post("effects", {"code": f"open({str(tmp_path / 'mark')!r}, 'w')"})
    assert (answer.status_code, "--allow-code" in answer.json()["error"]) == (400, True)
    assert not (tmp_path / "mark").exists()
    assert page.get("about").json()["template"] == ""
