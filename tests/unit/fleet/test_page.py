"""The page of a fleet: complete without script, one row an axis, nothing from the network."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from pmsm_ctrl.cli import main
from pmsm_ctrl.fleet.answers import answered
from pmsm_ctrl.fleet.store import Store
from tests.unit.fleet.rows import a_fleet

html5lib = pytest.importorskip("html5lib")
pytest.importorskip("pyarrow")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("page")
    Store(folder / "r").add(a_fleet(40, 8, 2))
    with pytest.raises(SystemExit) as left:
        main(["fleet", "report", str(folder / "r"), "-o", str(folder / "p.html"), "--json", str(folder / "p.json")])
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


def test_the_summary_names_the_axes(tmp_path: Path) -> None:
    text = answered("r", a_fleet(20, 8, 3), {}).summary(width=1000)
    assert "20 axes: 1 lack an effect" in text
    assert "cogging" in text


@pytest.mark.parametrize("words", [["report"], ["report", "nowhere"], ["report", "a", "b"]])
def test_what_the_report_refuses(words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as left:
        main(["fleet", *words])
    assert left.value.code == 2
