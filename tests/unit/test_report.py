"""The report: one self-contained, valid, accessible, reproducible page."""

from __future__ import annotations

import importlib
import json
import re
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree as Xml

import numpy as np
import pytest
from matplotlib.figure import Figure

from pmsm_ctrl import Design, Log, compare, diagnose, simulate, study, tune
from pmsm_ctrl.compensate import CompensationStudy, GainWindow, Metrics, Row, Variant
from pmsm_ctrl.diagnose import Diagnosis
from pmsm_ctrl.diagnose.figures import contributions, plane_of
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.rendering.svg import inline_svg
from pmsm_ctrl.report import Headline, headline_of, render
from pmsm_ctrl.report.headline import of_simulation
from pmsm_ctrl.result import Estimate
from pmsm_ctrl.section import Notice, Picture, Section, Table
from pmsm_ctrl.simulate import scenario
from tests.browser import measured, no_browser

VOID = {"meta", "link", "br", "hr", "img", "input"}


class Page(HTMLParser):
    """Checks nesting while it collects what the tests ask about."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.headings: list[int] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)
        self.close()
        assert self.open == [], f"never closed: {self.open}"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.tags.append((tag, given))
        if tag not in VOID:
            self.open.append(tag)
        if given.get("id"):
            self.ids.append(str(given["id"]))
        for name in ("href", "src", "xlink:href"):
            if name in given:
                self.links.append(str(given[name]))
        if re.fullmatch(r"h[1-6]", tag):
            self.headings.append(int(tag[1]))

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open, f"</{tag}> closes nothing"
        assert self.open[-1] == tag, f"</{tag}> closes <{self.open[-1]}>"
        self.open.pop()


def figure() -> Figure:
    made = Figure(figsize=(5, 3))
    axes = made.subplots()
    axes.plot(np.linspace(0, 1, 50), np.sin(np.linspace(0, 9, 50)), label=r"$F_c$ <&>")
    axes.set(xlabel="time [s]", ylabel="torque [N m]")
    axes.legend()
    return made


def sections() -> list[Section]:
    table = Table(("name", "value"), (("F_c", "0.0213"), ("F_v", "-1.68e-4"), ("note", "not <seen> & more")))
    doubt = Notice("not_excited", "not excited")
    one = Section("First <b>", ("Plain & simple.", doubt, table, Picture(figure, 'See "it" <here>.')))
    two = Section("Second", ("a\n  b", Picture(figure, "Again."), Picture(figure, "And again.")))
    return [one, two]


def drawn() -> str:
    headline = Headline("It was done.", "all is well.", True, (("0.0213 N m", "F_c"), ("1 %", "error"), ("3", "x")))
    return render(
        "Title <x>", sections(), headline=headline, notices=2 * [Notice("one", "doubt <one>")],
        facts={"design, SHA-256": "ab" * 32, "seed": "0"}, design_toml="[motor]\nJ = 1.0 # <tag>",
        command="pmsm-ctrl study 'a b.toml'",
    )  # fmt: skip


page = cache(drawn)  # one for all tests


def test_page_is_well_formed_and_says_first_things_first() -> None:
    text = page()
    parsed = Page(text)
    order = [
        text.index(w) for w in ("<h1>", "It was done.", "all is well.", "doubt", "<b>0.0213", "<h2>1.", "<h2>Appendix")
    ]
    assert order == sorted(order)
    assert text.count("doubt &lt;one&gt;") == 1
    assert len(set(parsed.ids)) == len(parsed.ids), "an id stands twice"
    assert {link for link in parsed.links if not link.startswith("#")} == set(), "the page asks the network"
    assert {link[1:] for link in parsed.links} <= set(parsed.ids), "a link leads nowhere"
    assert not re.search(r"url\((?!#)", text)
    assert "<script" not in text


def test_page_is_accessible() -> None:
    parsed = Page(page())
    assert ("html", {"lang": "en"}) in parsed.tags
    assert parsed.headings[0] == 1
    assert parsed.headings.count(1) == 1
    assert all(b - a <= 1 for a, b in zip(parsed.headings, parsed.headings[1:], strict=False)), (
        "a heading level is left out"
    )
    drawings = [given for tag, given in parsed.tags if tag == "svg"]
    assert len(drawings) == 3
    assert all(d["role"] == "img" and len(str(d["aria-label"])) > 20 for d in drawings)
    assert any("width=device-width" in str(given.get("content")) for tag, given in parsed.tags if tag == "meta")


def contrast(a: str, b: str) -> float:
    """Contrast ratio of WCAG 2.1 for two #rrggbb colours."""

    def luminance(colour: str) -> float:
        full = colour if len(colour) == 7 else "#" + "".join(2 * c for c in colour[1:])
        parts = [int(full[k : k + 2], 16) / 255 for k in (1, 3, 5)]
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    high, low = sorted((luminance(a), luminance(b)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def test_contrast_formula_and_the_pages_colours() -> None:
    assert contrast("#000000", "#ffffff") == pytest.approx(21.0)
    assert contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.01)  # the WCAG's well-known near miss
    colours = dict(re.findall(r"--(\w+): (#[0-9a-f]{6})", page()))
    for ink in ("ink", "soft", "accent"):
        for ground in ("#ffffff", colours["ground"], "#edf7f4", "#fdf2ea"):
            assert contrast(colours[ink], ground) > 4.5


def test_text_is_escaped() -> None:
    text = page()
    assert "<b>First" not in text
    assert "First &lt;b&gt;" in text
    assert "not &lt;seen&gt; &amp; more" in text
    assert "J = 1.0 # &lt;tag&gt;" in text


def test_same_input_same_bytes() -> None:
    assert drawn() == page()


def test_svg_stands_alone_and_shares_no_ids() -> None:
    first, second = inline_svg(figure, "a", 'x < y & "z"'), inline_svg(figure, "b", "x")
    root = Xml.fromstring(first)
    assert root.get("aria-label") == 'x < y & "z"'
    assert root.get("viewBox")
    assert root.get("width") is None
    ids = [set(re.findall(r'\bid="([^"]+)"', text)) for text in (first, second)]
    assert not ids[0] & ids[1]
    for text, known in zip((first, second), ids, strict=True):
        used = set(re.findall(r'href="#([^"]+)"', text)) | set(re.findall(r"url\(#([^)]+)\)", text))
        assert used
        assert used <= known
    assert len(first) < 60_000


def test_page_without_extras() -> None:
    Page(render("Bare", [Section("Only")]))


# ---- study ------------------------------------------------------------------------------------------------------


def axis() -> Design:
    return Design.from_dict(
        {"name": "../../etc/axis 1", "motor": {"J": 1e-4, "K_t": 1.0},
         "effects": [{"id": "coulomb", "F_c": 0.02}, {"id": "viscous", "F_v": 2e-4}]}
    )  # fmt: skip


def axis_log(seed: int = 0) -> Log:
    t = np.arange(0, 4, 1e-3)
    omega = 80 * np.sin(np.pi * t) + 40 * np.sin(2.6 * np.pi * t + 1)
    alpha = 80 * np.pi * np.cos(np.pi * t) + 104 * np.pi * np.cos(2.6 * np.pi * t + 1)
    torque = 1e-4 * alpha + 0.02 * np.sign(omega) + 2e-4 * omega
    return Log({"t": t, "omega": omega, "torque": torque + np.random.default_rng(seed).normal(0, 1e-3, t.size)})


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the pictures of a page empty: drawing them takes seconds, and other tests ask for it."""
    monkeypatch.setattr("pmsm_ctrl.rendering.html.inline_svg", lambda *given: "<svg></svg>")


@pytest.mark.usefixtures("undrawn")
def test_study_writes_one_page_inside_reports(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    found = study(axis(), axis_log(), command="pmsm-ctrl study axis.toml --log axis.csv")
    assert found.path.parent == Path("reports")
    assert [p.name for p in Path("reports").iterdir()] == [found.path.name]
    text = found.path.read_text(encoding="utf-8")
    Page(text)
    said = " ".join(found.summary().split())
    assert said.endswith(f"Left out: compensate, track and export; --complete runs them as well. report: {found.path}")
    json.dumps(found.to_dict(), allow_nan=False)
    assert len(found.headline.numbers) == 3
    assert "pmsm-ctrl study axis.toml --log axis.csv" in text


@pytest.mark.slow
def test_the_same_study_writes_the_same_page(tmp_path: Path) -> None:
    pages = [study(axis(), axis_log(), output=tmp_path / name).path.read_bytes() for name in ("one.html", "two.html")]
    assert pages[0] == pages[1]
    Page(pages[0].decode())
    assert len(pages[0]) < 3_000_000


def test_study_says_where_it_cannot_write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "reports").write_text("a file in the way", encoding="utf-8")
    with pytest.raises(RequestError, match="reports"):
        study(axis(), axis_log())


# ---- the report of a diagnosis ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def hidden_cogging() -> Diagnosis:
    design = Design.read(Path(__file__).resolve().parents[2] / "designs" / "seed_motor.toml")
    truth = design.with_effect("cogging", {"a_s": 0.004, "a_c": 0.003, "order": 24.0})
    motions = scenario("identification", design, duration=15.0), scenario("triangle", design, cycles=2.0)
    log, other = (simulate(design, motion, truth=truth, seed=s) for motion, s in zip(motions, (3, 4), strict=True))
    return diagnose(design, log, holdout=other, candidates=["cogging", "stribeck", "quadratic_drag", "torque_ripple"])


def test_diagnosis_report_shows_the_way_down(hidden_cogging: Diagnosis) -> None:
    section = hidden_cogging.section()
    captions = [block.caption for block in section.blocks if isinstance(block, Picture)]
    for word in ("error falls from", "Mean residual over speed and position", "fails worst", "contributes over speed"):
        assert any(word in caption for caption in captions), word
    errors = next(block for block in section.blocks if isinstance(block, Table))
    balances = "torque", "u_d", "u_q"
    names = [f"{name} error" for name in balances]
    assert errors.header == ("model", *names, *(f"held-out {name}" for name in names), "free run, position", "fit")
    falling = {row[0]: row[1:] for row in errors.rows}
    assert list(falling) == ["design as given", "parameters refitted", "+ cogging 24", "noise floor"]
    assert all(cell.endswith("%") for cell in falling["+ cogging 24"][:6]), "log and held-out record"
    assert falling["+ cogging 24"][6].endswith("rad")
    assert section.blocks[0] == "1 missing effect: Cogging torque."
    still = render("Diagnosis", [section], interactive=False)
    Page(still)
    assert len(still) < 1_500_000
    assert "<script" not in still


@pytest.mark.usefixtures("undrawn")
def test_first_screen_of_a_diagnosis(hidden_cogging: Diagnosis) -> None:
    headline = headline_of(hidden_cogging)
    assert headline is not None
    assert headline.verdict == "1 missing effect: Cogging torque."
    values = [hidden_cogging.errors[which]["torque"]["relative"] for which in ("nominal", "final")]
    values.append(hidden_cogging.steps[-1].holdout_after["torque"]["relative"])
    assert [value for value, _ in headline.numbers] == [f"{100 * value:.2f} %" for value in values]
    assert len({label for _, label in headline.numbers}) == 3, "a definition each"
    falling, maps = (picture.draw() for picture in headline.pictures)
    bars = sorted(round(bar.get_width(), 6) for bar in falling.axes[0].patches)
    assert bars == sorted(round(100 * v, 6) for v in (
        *values, hidden_cogging.errors["base"]["torque"]["relative"],
        hidden_cogging.steps[0].holdout_before["torque"]["relative"],
    ))  # fmt: skip
    assert len(maps.axes) == 3, "before, after, and the scale"
    section = hidden_cogging.section()
    text = render(section.title, [section], headline=headline, interactive=False)
    assert text.index("</figure>") < text.index("<table")
    assert headline_of(compare(axis(), axis_log())) is None


def test_no_sweep_is_simulated_below_a_log(monkeypatch: pytest.MonkeyPatch, designs: Path) -> None:
    design = Design.read(designs / "seed_motor.toml")
    chain = importlib.import_module("pmsm_ctrl.report.chain")
    monkeypatch.setattr(chain, "tune", lambda design, **_: "tuned")
    monkeypatch.setattr(chain, "sweep", lambda *_, **__: pytest.fail("swept"))
    results, _ = chain._simulated_parts(design, False, 0, lambda share: None)
    assert set(results) == {"tune"}


def figures(section: Section) -> list[Figure]:
    return [block.draw() for block in section.blocks if isinstance(block, Picture)]


def test_every_figure_has_units_on_its_axes(hidden_cogging: Diagnosis) -> None:
    results = [hidden_cogging, compare(axis(), axis_log())]
    for made in (figure for result in results for figure in figures(result.section())):
        labels = [made.get_supxlabel(), made.get_supylabel()]
        for panel in made.axes:
            shown = [panel.get_xlabel(), panel.get_ylabel()]
            labels += [text for text in shown if text]
        assert labels
        for text in labels:
            assert not text or "[" in text or "SI units" in text, f"no unit in '{text}'"


def test_contributions_sum_to_the_prediction(hidden_cogging: Diagnosis) -> None:
    fit = hidden_cogging.selection.fits[-1]
    parts = contributions(fit)
    assert {"inertia", "coulomb", "viscous", "cogging 24"} <= set(parts)
    predicted = fit.record.target[0] - fit.residual[0]
    assert sum(parts.values()) == pytest.approx(predicted, abs=1e-12)
    # what was hidden: 4 and 3 mN m of order 24
    slow = np.abs(fit.record.at_grid(fit.record.signals["omega"])) < 5.0
    assert np.sqrt(2.0 * np.mean(parts["cogging 24"][slow] ** 2)) == pytest.approx(0.005, rel=0.15)


def test_residual_maps_fade(hidden_cogging: Diagnosis) -> None:
    before, after = (fit for fit in hidden_cogging.selection.fits)
    plane = plane_of(hidden_cogging)
    assert plane.label == "angle in a wave of order 24 [rad]"
    slow = before.record.mask & (np.abs(before.record.at_grid(before.record.signals["omega"])) < 8.0)
    cell = np.digitize(plane.values[slow], np.linspace(0.0, 2.0 * np.pi, 9))
    means = [[fit.residual[0][slow][cell == k].mean() for k in range(1, 9)] for fit in (before, after)]
    assert np.max(np.abs(means[1])) < 0.2 * np.max(np.abs(means[0]))


def test_clean_diagnosis_has_a_report_too(designs: Path) -> None:
    design = Design.read(designs / "seed_motor.toml")
    found = diagnose(design, simulate(design, scenario("triangle", design, cycles=1.0), seed=1), candidates=["cogging"])
    captions = [block.caption for block in found.section().blocks if isinstance(block, Picture)]
    assert any("No effect was accepted" in caption for caption in captions)


@no_browser
def test_browser_draws_the_page_without_sideways_scrolling(tmp_path: Path) -> None:
    wide = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
    assert measured([(page(), width, 900, wide) for width in (390, 1100)], tmp_path) == [0, 0]


@pytest.mark.slow
@no_browser
def test_the_widest_tables_fit_a_desk(tmp_path: Path, designs: Path) -> None:
    """Tuning and compensation have the widest tables of all; at 1100 px they wrap before they scroll."""
    design = Design.read(designs / "seed_motor.toml")
    sections = [tune(design, prove=False).section(), wide_compensation(design).section()]
    wide = "Math.max(...[...document.querySelectorAll('.scroll')].map((e) => e.scrollWidth - e.clientWidth))"
    assert measured([(render("Wide", sections), 1100, 900, wide)], tmp_path) == [0]


def wide_compensation(design: Design) -> CompensationStudy:
    """A study with its longest names and numbers of many digits, without the minutes it takes to run one."""
    many = Metrics(0.000123, 0.000123, 0.000123, 0.123, 0.000123, 0.0123, 0.00123, 0.00123)
    motions = ("reversal 0.5 rad/s", "triangle", "creep 0.1 rad/s", "circle", "warm-up")
    variants = ((Variant.NONE, 1.0), (Variant.COMMANDED, 0.8))
    table = tuple(Row(name, motion, factor, many) for name, factor in variants for motion in motions)
    gains = np.array([0.0, 1.0])
    window = GainWindow("commanded", gains, gains, gains, gains, 0.00123 * gains, 0.0, 0.0, None)
    return CompensationStudy(design, table, {"commanded": window})


def test_tables_have_their_captions_and_one_section_one_title() -> None:
    named, plain = (Table(("name", "value"), (("F_c", "1"),), caption) for caption in ("First & foremost", ""))
    text = render("Only", [Section("Only", (named, plain))])
    Page(text)
    assert text.count("<caption>") == 1
    assert text.index("First &amp; foremost") < text.index("F_c")
    assert "1. Only" not in text


@pytest.mark.parametrize(("F_c", "told"), [(0.0, False), (0.02, True)])
def test_a_design_without_friction_has_no_share_of_it_in_the_headline(designs: Path, F_c: float, told: bool) -> None:
    """The line misses 99 % of a torque that is noise alone: no number for a first screen."""
    bare = Design.read(designs / "seed_motor.toml").with_effect("coulomb", {"F_c": F_c}).without_effect("viscous")
    estimates = {"F_c": Estimate(F_c + 1e-6, "N m")}
    swept = SimpleNamespace(estimates=estimates, rms_percent=99.3, levels=(), section=lambda: Section("Sweep"))
    headline = of_simulation(bare, swept, 10.0)
    assert ("99.30 %" in dict(headline.numbers)) is told
    assert ("identify finds it from a log" in headline.verdict) is not told


@pytest.mark.parametrize(
    ("off", "stderr", "good", "said"),
    [
        (0.009, 0.001, True, "within 0.90 % (accepted: 1 %)"),
        (0.03, 0.015, None, "(accepted: 1 %): the noise of the simulation explains this"),
        (0.03, 0.005, False, "(accepted: 1 %): more than the noise of the simulation explains"),
        (0.03, float("nan"), False, "(accepted: 1 %): more than the noise of the simulation explains"),
    ],
)
def test_a_sweep_says_whether_its_noise_or_it_misses_the_friction(
    off: float, stderr: float, good: bool | None, said: str, designs: Path
) -> None:
    axis = Design.read(designs / "seed_motor.toml").with_effect("coulomb", {"F_c": 0.02}).without_effect("viscous")
    estimates = {"F_c": Estimate(0.02 * (1.0 + off), "N m", 0.02 * stderr)}
    swept = SimpleNamespace(estimates=estimates, rms_percent=1.0, levels=(), section=lambda: Section("Sweep"))
    headline = of_simulation(axis, swept, 10.0)
    assert headline.good is good
    assert said in headline.verdict
