"""The page of a fleet: complete without script, one row an axis, nothing from the network."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from pmsm_ctrl.cli import main
from pmsm_ctrl.fleet import FleetResult
from pmsm_ctrl.fleet.answers import answered
from pmsm_ctrl.fleet.store import Store
from tests.unit.fleet.rows import a_fleet, of_record

html5lib = pytest.importorskip("html5lib")
pytest.importorskip("pyarrow")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("page")
    Store(folder / "r").add(a_fleet(40, 8, 2))
    with pytest.raises(SystemExit) as left:
        main(["fleet", "report", str(folder / "r"), "-o", str(folder / "p.html"), "--json", str(folder / "p.json"),
              "--no-axis-pages"])  # fmt: skip
    assert left.value.code in (0, None)
    return (folder / "p.html").read_text(encoding="utf-8")


def test_the_page_is_strict_html_with_a_row_and_a_curve_for_every_axis(page: str) -> None:
    html5lib.HTMLParser(strict=True).parse(page)
    assert len(re.findall(r"<td[^>]*>axis\d{4}</td>.*?<svg class=\"spark\"", page)) >= 40
    assert 'aria-label="F_c over 8 records: first ' in page


def test_the_page_asks_the_network_for_nothing_and_permits_its_own_script_alone(page: str) -> None:
    assert not re.search(r"(?:src|href)=\"(?!#|data:)", page)
    assert page.count("<script>") == 1
    assert re.search(r"script-src 'sha256-[^']+'; ", page)


def test_every_axis_has_a_page_that_the_fleet_links(tmp_path: Path) -> None:
    store = Store(tmp_path / "r")
    store.add([*a_fleet(3, 8, 2), *of_record("../A 1", 0, 0.02), *of_record("AXIS0003", 0, 0.02)])
    page = tmp_path / "p.html"
    with pytest.raises(SystemExit):
        main(["fleet", "report", str(tmp_path / "r"), "-o", str(page)])
    text = page.read_text(encoding="utf-8")
    linked = set(re.findall(r'<a href="(p_axes/[^"]+)">', text))
    assert {tmp_path / one for one in linked} == set((tmp_path / "p_axes").iterdir())
    assert len(linked) == 5
    own = (tmp_path / "p_axes" / "axis0001.html").read_text(encoding="utf-8")
    html5lib.HTMLParser(strict=True).parse(own)
    assert "cogging" in own
    assert "axis0002" not in own
    assert len(re.findall(r"<td[^>]*>2026-03-\d\d 22:00</td>", own)) == 8
    assert not re.search(r"(?:src|href)=\"(?!#|data:)", own)
    with pytest.raises(SystemExit) as left:  # pages of another report are not overwritten
        main(["fleet", "report", str(tmp_path / "r"), "-o", str(tmp_path / "p.html")])
    assert left.value.code == 2


def test_watch_writes_the_pages_that_the_fleet_links(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    results = tmp_path / "r"
    Store(results).add(a_fleet(1, 4, 0))
    done = FleetResult(str(results), 1, 4, 4, 0, {}, (), 1.0, 1.0, ())

    def looks_twice(manifest: object, told: Callable[[FleetResult], None], **_: object) -> None:
        told(done)
        told(done)  # its own pages are renewed

    monkeypatch.setattr("pmsm_ctrl.fleet.watch.watch", looks_twice)
    with pytest.raises(SystemExit) as left:
        main(["fleet", "watch", str(tmp_path), "-d", "axis.toml", "-o", str(results)])
    assert left.value.code in (None, 0)
    linked = re.findall(r'<a href="(fleet_axes/[^"]+)">', (results / "fleet.html").read_text(encoding="utf-8"))
    assert {results / one for one in linked} == set((results / "fleet_axes").iterdir()) != set()


def test_the_summary_names_the_axes(tmp_path: Path) -> None:
    text = answered("r", a_fleet(20, 8, 3), {}).summary(width=1000)
    assert "20 axes: 1 lacks an effect" in text
    assert "cogging" in text


@pytest.mark.parametrize("words", [["report"], ["report", "nowhere"], ["report", "a", "b"]])
def test_what_the_report_refuses(words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as left:
        main(["fleet", *words])
    assert left.value.code == 2


def test_one_log_of_one_axis_is_singular() -> None:
    text = FleetResult("results", 1, 1, 1, 0, {}, (), 1.0, 1.0, ()).summary()
    assert "1 log of 1 axis: 1 with an answer" in " ".join(text.split())
