"""The interactive part of a page: what is drawn, what the switches compute, and what a browser makes of it."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.stats import binned_statistic_2d

from pmsm_ctrl.rendering import live
from pmsm_ctrl.report import Headline, render
from pmsm_ctrl.section import Balance, Notice, Picture, Section, Table, Traces

pytest.importorskip(
    "bokeh", reason="BOKEH ABSENT: interactive pages were not made (pip install 'pmsm-ctrl[interactive]')"
)
no_browser = pytest.mark.skipif(
    shutil.which("chromium") is None, reason="CHROMIUM ABSENT: the page was not drawn (apt install chromium)"
)
HOSTILE = "<script>alert(1)</script>"
M = 2000
T = np.linspace(0.0, 10.0, M)
NOISE = 0.01 * np.random.default_rng(1).normal(size=M)
PARTS = {"cogging 24": 0.2 * np.sin(9.0 * T), HOSTILE: 0.1 * np.cos(5.0 * T)}


def traces() -> Traces:
    measured = np.sin(T) + sum(PARTS.values()) + NOISE
    rows = np.array([NOISE, *PARTS.values()])
    size = float(np.sqrt(np.mean(measured**2)))
    torque = Balance("torque", "N m", measured, measured - NOISE, PARTS, rows @ rows.T / M, size, 0.012)
    voltage = Balance("u_q", "V", 2.0 * np.cos(T), 2.0 * np.cos(T), {}, np.zeros((1, 1)), 1.4, 0.0)
    coordinates = {"speed [rad/s]": np.cos(T), "acceleration [rad/s²]": -np.sin(T)}
    return Traces(T, coordinates, (torque, voltage), ((2.0, 3.0, "reversal"), (5.0, 6.0, HOSTILE)), "a.csv")


def with_held_out() -> Traces:
    """The same with two records that were held out, of other lengths, without voltages."""
    held = []
    for number, scale in enumerate((2.0, 3.0)):
        t, noise, part = 20.0 + T[: M // (number + 1)], scale * NOISE[: M // (number + 1)], scale * PARTS["cogging 24"]
        part = part[: len(t)]
        measured = np.sin(t) + part + noise
        rows = np.array([noise, part])
        size = float(np.sqrt(np.mean(measured**2)))
        torque = Balance(
            "torque",
            "N m",
            measured,
            measured - noise,
            {"cogging 24": part},
            rows @ rows.T / len(t),
            size,
            0.01,
            len(t),
        )
        coordinates = {"speed [rad/s]": np.cos(t), "acceleration [rad/s²]": -np.sin(t)}
        held.append(Traces(t, coordinates, (torque,), ((21.0, 22.0, "start"),), f"{HOSTILE}{number}"))
    return replace(traces(), held_out=tuple(held))


def test_samples_that_do_not_count_are_neither_drawn_nor_do_they_set_a_scale() -> None:
    """Where two logs are joined the filters swing: a peak there hid the residual of everything else."""
    whole = traces()
    used = np.ones(M, dtype=bool)
    used[900:950], used[-1] = False, False
    torque = whole.balances[0]
    swings = np.where(used, torque.measured, 50.0)
    joined = replace(whole, balances=(replace(torque, measured=swings), *whole.balances[1:]), used=used)
    chosen = live._chosen(joined, 500)
    assert used[chosen].all()
    assert len(chosen) > 300
    note = live._note((joined,))
    assert "51 samples at rest, or where a record begins or ends, do not count and are not drawn." in note
    assert "Errors are computed from all samples that count." in note
    assert "do not count" not in live._note((whole,))


@pytest.mark.parametrize("most", [200, 10 * M])
def test_the_lines_of_two_records_are_not_joined(most: int) -> None:
    whole = traces()
    later = replace(whole, t=np.where(np.arange(M) < 700, whole.t, whole.t + 30.0))
    keep = live._chosen(later, most)
    t = live._times(later, keep)
    (gap,) = np.flatnonzero(np.isnan(t))
    assert keep[gap] < 700 <= keep[gap + 1]
    assert np.array_equal(np.delete(t, gap), np.delete(later.t[keep], gap))
    assert np.isfinite(live._times(whole, keep)).all()


def held_out_error(*names: str) -> float:
    """Rms of what is left over on both held-out records together, in percent of the measured rms."""
    balances = [one.balances[0] for one in with_held_out().held_out]
    left = np.concatenate([b.measured - b.predicted + sum(b.parts.get(n, 0.0) for n in names) for b in balances])
    return float(100.0 * np.sqrt(np.mean(left**2) / np.mean(np.concatenate([b.measured for b in balances]) ** 2)))


def error_without(*names: str) -> float:
    """Rms of what is left over, by definition, as a share of the measured rms, in percent."""
    left = NOISE + sum(PARTS[name] for name in names)
    return float(100.0 * np.sqrt(np.mean(left**2) / np.mean(traces().balances[0].measured ** 2)))


def picture() -> Figure:
    made = Figure(figsize=(4, 3))
    made.subplots().plot([0, 1], [0, 1])
    return made


def page(interactive: bool | None = True, shown: Traces | None = None) -> str:
    table = Table(("name", HOSTILE), ((HOSTILE, "1"),), HOSTILE)
    blocks = (HOSTILE, Notice("doubt", HOSTILE), shown or traces(), table, Picture(picture, f"Second {HOSTILE}"))
    headline = Headline(HOSTILE, HOSTILE, None, ((HOSTILE, HOSTILE),), (Picture(picture, HOSTILE),))
    return render(
        HOSTILE, [Section("First", blocks), Section(HOSTILE, (HOSTILE,))], headline=headline,
        notices=[Notice("doubt", HOSTILE), Notice("other", HOSTILE)], facts={"log": HOSTILE, HOSTILE: "x"},
        design_toml=f'name = "{HOSTILE}"', command=HOSTILE, interactive=interactive,
    )  # fmt: skip


# ---- what is drawn ----------------------------------------------------------------------------------------------


def test_thinning_keeps_every_extreme_of_a_bin_and_its_count() -> None:
    rows = np.random.default_rng(2).normal(size=(3, 100_000))
    chosen = live.thinned(rows, 4000)
    assert 2500 < len(chosen) <= 4000
    assert np.all(np.diff(chosen) > 0)
    for row in rows:
        assert row[chosen].max() == row.max()
        assert row[chosen].min() == row.min()
    spike = np.zeros((2, 50_000))
    spike[1, 31_234] = 1.0
    assert 31_234 in live.thinned(spike, 500)
    assert list(live.thinned(rows[:, :500], 500)) == list(range(500))


@pytest.mark.slow
def test_same_traces_same_bytes() -> None:
    assert live.live_html(traces(), "a") == live.live_html(traces(), "a")
    assert page() == page()


def test_no_script_element_ends_early_and_the_policy_names_both() -> None:
    text = page()
    found = Scripts(text)
    assert len(found.run) == 2, "Bokeh's and the package's"
    assert not any("alert(1)" in script for script in found.run)
    data = [json.loads(script) for script in found.data]
    assert list(data[0]["records"][0]["balances"][0]["parts"]) == list(PARTS)
    policy = re.search('Content-Security-Policy" content="([^"]*)"', text)
    assert policy is not None
    assert policy[1].count("'sha256-") == 2
    assert "unsafe-eval" not in policy[1]
    assert "default-src 'none'" in policy[1]
    assert not any(tag in ("link", "iframe", "object", "embed") for tag in found.tags)


def test_without_bokeh_a_page_has_figures_and_no_script(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "available", lambda: False)
    text = page(None)
    assert "<script" not in text
    assert text.count("<svg") == 2
    assert "script-src 'none'" in text


class Scripts(HTMLParser):
    """Collects the scripts of a page: those that run, and those that are data."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.run: list[str] = []
        self.data: list[str] = []
        self.tags: list[str] = []
        self.into: list[str] | None = None
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag == "script":
            assert "src" not in dict(attrs)
            self.into = self.data if dict(attrs).get("type") == "application/json" else self.run
            self.into.append("")

    def handle_data(self, data: str) -> None:
        if self.into is not None:
            self.into[-1] += data

    def handle_endtag(self, tag: str) -> None:
        if tag == "script":
            self.into = None


# ---- in a browser -----------------------------------------------------------------------------------------------


def browsed(text: str, folder: Path) -> tuple[str, str]:
    """Return the page as the browser holds it after its scripts have run, and what was said on the console."""
    path = folder / "page.html"
    path.write_text(text, encoding="utf-8")
    command = [
        "chromium", "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
        "--disable-background-networking", "--disable-component-update", "--disable-sync", "--enable-logging=stderr",
        "--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={folder / 'profile'}", "--window-size=1280,3000",
        "--virtual-time-budget=10000", "--dump-dom", path.as_uri(),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    console = [line for line in done.stderr.splitlines() if "CONSOLE" in line and "document idle" not in line]
    return done.stdout, "\n".join(console)


def said(text: str) -> str:
    found = re.search(r"<output[^>]*>([^<]*)</output>", text)
    assert found is not None
    return found[1]


@no_browser
def test_browser_draws_under_the_policy_and_shows_hostile_names_as_text(tmp_path: Path) -> None:
    text, console = browsed(page(), tmp_path)
    assert console == ""
    assert 'data-drawn="yes"' in text
    assert said(text) == f"torque error with all effects: {error_without():.3g} %; noise floor 1.20 %"
    assert not any("alert(1)" in script for script in Scripts(text).run)
    assert f"<title>{HOSTILE.replace('<', '&lt;').replace('>', '&gt;')}</title>" in text


STEPS = """<script>
(async () => {
  const wait = () => new Promise((done) => setTimeout(done, 50));
  const part = document.querySelector(".live");
  while (!part.dataset.drawn) await wait();
  const output = () => part.querySelector("output").textContent;
  const get = (name) => Bokeh.documents[0].get_model_by_name(part.id + "-" + name);
  const rms = (values) => Math.sqrt(values.reduce((sum, x) => sum + x * x, 0) / values.length);
  const out = { on: output(), first: rms(get("source").data.residual) };
  const press = (box, checked) => { box.checked = checked; box.dispatchEvent(new Event("change")); };
  const boxes = [...part.querySelectorAll("input[data-part]")];
  press(boxes[0], false);
  out.off = output();
  out.second = rms(get("source").data.residual);
  press(boxes[1], false);
  out.both = output();
  boxes.forEach((box) => press(box, true));
  out.again = output();
  part.querySelector("button[data-start]").click();
  out.range = [get("time").start, get("time").end];
  [...part.querySelectorAll("button[data-start]")].at(-1).click();
  out.whole = [get("time").start, get("time").end];
  const over = part.querySelector("[data-role=coordinate]");
  over.selectedIndex = 1;
  over.dispatchEvent(new Event("change"));
  out.over = get("scatter").below[0].axis_label;
  const against = part.querySelector("[data-role=against]");
  against.selectedIndex = 1;
  against.dispatchEvent(new Event("change"));
  const { over: x, speed: y, residual: r } = get("source").data;
  const { mean, count, x: across, y: up } = get("tiles").data;
  const shown = () => [get("dots").visible, get("map").visible];
  out.map = { x: [...x], y: [...y], r: [...r], mean, count, across, up, shown: shown(),
    labels: [get("scatter").left[0].axis_label, get("scatter").below[0].axis_label] };
  against.selectedIndex = 0;
  against.dispatchEvent(new Event("change"));
  out.back = [...shown(), get("scatter").left[0].axis_label];
  const balance = part.querySelector("[data-role=balance]");
  balance.selectedIndex = 1;
  balance.dispatchEvent(new Event("change"));
  out.balance = [output(), get("upper").left[0].axis_label];
  document.title = JSON.stringify(out);
})();
</script></body>"""


@no_browser
@pytest.mark.slow
def test_switches_move_the_error_and_the_residual(tmp_path: Path) -> None:
    text = re.sub('<meta http-equiv="Content-Security-Policy"[^>]*>', "", page())  # it forbids the test's script
    text, console = browsed(text.replace("</body>", STEPS), tmp_path)
    assert console == ""
    title = re.search("<title>([^<]*)</title>", text)
    assert title is not None
    out = json.loads(title[1].replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&"))
    assert out["on"] == out["again"]
    assert f"error without cogging 24: {error_without('cogging 24'):.1f} %" in out["off"]
    assert f": {error_without(*PARTS):.1f} %, {error_without():.3g} % with all effects" in out["both"]
    assert out["first"] == pytest.approx(np.sqrt(np.mean(NOISE**2)), rel=1e-3)
    assert out["second"] == pytest.approx(np.sqrt(np.mean((NOISE + PARTS["cogging 24"]) ** 2)), rel=1e-3)
    assert out["range"] == pytest.approx([1.5, 3.5])
    assert out["whole"] == pytest.approx([0.0, 10.0])
    assert out["over"] == "acceleration [rad/s²]"
    assert out["balance"][0].startswith("u_q error with all effects")
    assert out["map"]["labels"][0] == "speed [rad/s]"
    assert out["map"]["labels"][1].startswith("acceleration [rad/s²]; colour: mean residual, -")
    assert (out["map"]["shown"], out["back"]) == ([False, True], [True, False, "residual [N m]"])
    tiles = {name: np.array(out["map"][name]) for name in ("x", "y", "r", "mean", "count", "across", "up")}
    expected = binned_statistic_2d(tiles["x"], tiles["y"], tiles["r"], bins=(36, 18))
    drawn = np.full((36, 18), np.nan)
    places = (np.searchsorted(edges, tiles[name]) - 1 for name, edges in
              (("across", expected.x_edge), ("up", expected.y_edge)))  # fmt: skip
    drawn[tuple(places)] = tiles["mean"]
    same = np.isclose(drawn, expected.statistic, rtol=1e-3, atol=1e-6, equal_nan=True)
    assert np.mean(same) > 0.99  # in single precision a sample on an edge may fall to either side
    assert tiles["count"].sum() == len(tiles["x"])
    assert out["balance"][1] == "u_q [V]"


RECORDS = STEPS.replace(
    "  const boxes",
    """  const press_record = (k) => {
    const list = part.querySelector("[data-role=record]");
    list.selectedIndex = k;
    list.dispatchEvent(new Event("change"));
    return [rms(get("source").data.residual), get("source").data.t.length, get("time").start, get("time").end,
      [...part.querySelectorAll("button[data-record]")].filter((one) => !one.hidden).map((one) => +one.dataset.start)];
  };
  const width = () => [...part.querySelectorAll(".fill")].map((one) => parseFloat(one.style.width));
  out.widths = [width()];
  out.titles = [...part.querySelectorAll("[data-role=record] option")].map((one) => one.textContent);
  const boxes""",
).replace("  out.second", "  out.widths.push(width());\n  out.held = [1, 2, 0].map(press_record);\n  out.second")


@no_browser
@pytest.mark.slow
def test_switches_move_the_error_of_the_held_out_records_as_well(tmp_path: Path) -> None:
    text = re.sub('<meta http-equiv="Content-Security-Policy"[^>]*>', "", page(shown=with_held_out()))
    text, console = browsed(text.replace("</body>", RECORDS), tmp_path)
    assert console == ""
    title = re.search("<title>([^<]*)</title>", text)
    assert title is not None
    out = json.loads(title[1].replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&"))
    assert out["titles"] == ["a.csv, fitted", f"{HOSTILE}0, held out", f"{HOSTILE}1, held out"]
    fitted, held = (f"{one():.3g}" for one in (error_without, held_out_error))
    assert out["on"] == f"torque error with all effects: fitted {fitted} %, held out {held} %; noise floor 1.20 %"
    both = f"fitted {error_without('cogging 24'):.1f} %, held out {held_out_error('cogging 24'):.1f} %"
    assert f"without cogging 24: {both} (with all effects: fitted {fitted} %, held out {held} %)" in out["off"]
    assert np.all(np.array(out["widths"][1]) > 5.0 * np.array(out["widths"][0]))
    for k, one in enumerate(with_held_out().held_out):
        balance = one.balances[0]
        left = balance.measured - balance.predicted + balance.parts["cogging 24"]
        assert out["held"][k][0] == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-3)
        assert out["held"][k][1:] == [len(one.t), pytest.approx(20.0), pytest.approx(one.t[-1]), [21.0]]
    assert out["held"][2][0] == pytest.approx(out["second"])
