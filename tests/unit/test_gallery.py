"""The committed reports: valid, accessible, small, without network, drawn by a browser, and EMPS without its data."""

from __future__ import annotations

import io
import itertools
import re
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
import pytest

from tests.browser import browser, measured, no_browser
from tests.effort import amount

html5lib = pytest.importorskip("html5lib", reason="HTML5LIB ABSENT: the gallery was not parsed (pip install html5lib)")

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted((ROOT / "reports" / "gallery").glob("*.html"))
NAMES = {"reference_experiment", "emps", "hidden_effects", "compensation"}
LIMIT = 3_000_000


def parsed(path: Path) -> Element:
    """Parse as the HTML standard says, with every parse error an error."""
    parser = html5lib.HTMLParser(strict=True, namespaceHTMLElements=False)
    return parser.parse(path.read_text(encoding="utf-8"))


def text_of(element: Element) -> str:
    return " ".join(" ".join(element.itertext()).split())


def test_all_four_are_there() -> None:
    assert {path.stem for path in PAGES} == NAMES


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_page_is_valid_small_and_asks_no_network(page: Path) -> None:
    assert page.stat().st_size < LIMIT
    tree = parsed(page)
    ids = [e.get("id") for e in tree.iter() if e.get("id")]
    assert len(ids) == len(set(ids)), "an id stands twice"
    for element in tree.iter():
        assert element.tag not in ("iframe", "link", "object", "embed")
        if element.tag == "script":
            assert set(element.attrib) <= {"type", "class"}, "a script from elsewhere"
        for name, value in element.attrib.items():
            if str(name).rpartition("}")[2] in ("href", "src"):
                assert value.startswith(("#", "data:")), f"{element.tag} asks for {value[:80]}"
                if value.startswith("#"):
                    assert value[1:] in ids, f"{value} leads nowhere"
    text = re.sub("<script.*?</script>", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert not re.search(r"url\((?!#)|@import", text)
    policy = next(e for e in tree.iter("meta") if e.get("http-equiv") == "Content-Security-Policy").get("content")
    assert policy is not None
    assert policy.startswith("default-src 'none'; script-src '"), "what a script asks for, the browser refuses"
    assert not re.search("https?:|unsafe-eval|script-src[^;]*unsafe-inline", policy)


def test_only_simulated_records_can_be_zoomed() -> None:
    """The measured data of EMPS must not be redistributed; the record with hidden effects is simulated."""
    zoomed = {page.stem for page in PAGES if 'class="live"' in page.read_text(encoding="utf-8")}
    assert zoomed == {"hidden_effects"}


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
@pytest.mark.slow
def test_page_is_accessible(page: Path) -> None:
    tree = parsed(page)
    assert tree.get("lang") == "en"
    title = tree.find("head/title")
    assert title is not None
    assert len(text_of(title)) > 5
    levels = [int(e.tag[1]) for e in tree.iter() if re.fullmatch("h[1-6]", str(e.tag))]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(b - a <= 1 for a, b in itertools.pairwise(levels)), "a heading level is left out"
    assert tree.find(".//main") is not None
    drawings = [e for e in tree.iter() if str(e.tag).rpartition("}")[2] == "svg"]
    assert drawings
    assert all(e.get("role") == "img" and len(e.get("aria-label") or "") > 20 for e in drawings)
    assert len(tree.findall(".//figcaption")) == len(drawings), "a figure without a sentence"
    assert all(e.get("scope") for e in tree.iter("th")), "a table head of nothing"


def test_emps_page_holds_no_measured_curve() -> None:
    """A record has 24,841 samples: no path, no set of markers and no picture on the page may come near."""
    tree = parsed(ROOT / "reports" / "gallery" / "emps.html")
    uses = 0
    for element in tree.iter():
        tag = str(element.tag).rpartition("}")[2]
        assert tag not in ("image", "img"), "a picture may hold the data"
        uses += tag == "use" and "href" in "".join(map(str, element.attrib))
        outline = element.get("d") or ""
        # Letters are outlines too, of curves; what is drawn over time or speed is of straight lines.
        assert outline.count("L") <= 150, f"a curve of {outline.count('L')} points"
    markers = [e for e in tree.iter() if str(e.tag).endswith("use") and e.get("style") is not None]
    assert len(markers) < 150, f"{len(markers)} of {uses} points"


def test_the_readme_says_of_emps_what_its_page_says() -> None:
    """Percentages of the README's table, effect by effect, are those of the committed page."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| \+ [^|]+\| ([\d.]+ %) \| ([\d.]+ %) \|$", readme, re.MULTILINE)
    tree = parsed(ROOT / "reports" / "gallery" / "emps.html")
    table = next(t for t in tree.iter("table") if text_of(t).startswith("effect"))
    shown = [[text_of(cell) for cell in row] for row in table.iter("tr")][1:]
    assert rows == [(cells[3], cells[4]) for cells in shown]


@no_browser
def test_a_phone_needs_no_sideways_scrolling_and_the_first_screen_shows_the_error_falling(tmp_path: Path) -> None:
    """Both pictures end within the window that issue 22 names, below the verdict, with no table above them."""
    root = "document.documentElement"
    wide = f"{root}.scrollWidth - {root}.clientWidth"
    bottoms = "[...document.querySelectorAll('.verdict, .hero svg')].map((e) => e.getBoundingClientRect().bottom)"
    top = "(document.querySelector('table')?.getBoundingClientRect().top ?? 1e6)"
    texts = {page.stem: page.read_text("utf-8") for page in PAGES}
    first = [(texts["hidden_effects"], *size, f"[...{bottoms}, {top}]") for size in [(390, 844), (1280, 800)]]
    phones = [(text, 390, 844, wide) for text in list(texts.values())[: amount(1, len(texts))]]
    first = first[: amount(1, 2)]
    said = measured([*first, *phones], tmp_path)
    for (_, _, height, _), (verdict, *pictures, table) in zip(first, said, strict=False):
        assert len(pictures) == 2
        assert verdict < min(pictures)
        assert max(pictures) <= height
        assert table > max(pictures)
    assert said[len(first) :] == [0] * len(phones)


@no_browser
@pytest.mark.slow  # a page that was drawn just now: tests/unit/test_report.py
@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_browser_draws_the_page(page: Path, tmp_path: Path) -> None:
    picture, unfolded = tmp_path / "page.png", tmp_path / "page.html"
    unfolded.write_text(page.read_text("utf-8").replace("<details", "<details open"), encoding="utf-8")
    browser("--window-size=1100,4000", f"--screenshot={picture}", unfolded.as_uri(), profile=tmp_path / "profile")
    pixels = image(picture)
    assert pixels.shape[:2] == (4000, 1100)
    dark = pixels.mean(axis=2) < 0.6
    end = int(np.flatnonzero(dark.any(axis=1))[-1])
    assert end > 2000, "the page is hardly longer than its first screen"
    # Every screenful up to the page's end has something on it, and the page is not one dark slab.
    for top in range(0, end - 500, 1000):
        share = dark[top : top + 1000].mean()
        assert 0.002 < share < 0.5, f"{share:.2%} of what begins at {top} px is dark"
    coloured = (np.ptp(pixels, axis=2) > 0.3).mean()
    assert coloured > 1e-3, "no figure was drawn"


def image(path: Path) -> np.ndarray[Any, np.dtype[np.float64]]:
    from matplotlib.image import imread

    return np.asarray(imread(io.BytesIO(path.read_bytes()), format="png"), dtype=np.float64)[:, :, :3]
