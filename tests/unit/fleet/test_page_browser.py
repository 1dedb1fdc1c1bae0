"""The tables of the fleet's page in a browser: sorted by a click, filtered by words, linked to the axes."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from pmsm_ctrl.cli import main
from pmsm_ctrl.fleet.store import Store
from tests.unit.fleet.rows import a_fleet

pytest.importorskip("pyarrow")
webdriver = pytest.importorskip("selenium.webdriver")
CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]
if CHROMIUM is None or DRIVER is None:
    pytest.skip("CHROMIUM ABSENT: apt-get install chromium chromium-driver", allow_module_level=True)


def test_axes_are_sorted_filtered_and_linked(tmp_path: Path) -> None:
    from selenium.webdriver.common.by import By

    Store(tmp_path / "r").add(a_fleet(6, 8, 2))
    with pytest.raises(SystemExit):
        main(["fleet", "report", str(tmp_path / "r"), "-o", str(tmp_path / "p.html")])
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for word in ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"):
        options.add_argument(word)
    browser = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    try:
        browser.get((tmp_path / "p.html").as_uri())
        table = browser.find_element(By.CSS_SELECTOR, "table.sortable")

        def shown() -> list[str]:
            rows = table.find_elements(By.CSS_SELECTOR, "tbody tr")
            return [row.find_element(By.TAG_NAME, "td").text for row in rows if row.is_displayed()]

        names = [f"axis000{k}" for k in range(1, 7)]
        assert shown() == names
        head = table.find_element(By.CSS_SELECTOR, "th button")
        head.click()
        assert shown() == names
        head.click()
        assert shown() == names[::-1]
        assert table.find_element(By.TAG_NAME, "th").get_attribute("aria-sort") == "descending"
        words = browser.find_element(By.CSS_SELECTOR, "label.filter input")
        words.send_keys("cogging missing")
        assert shown() == ["axis0001"]
        words.clear()
        words.send_keys("none of them")
        assert shown() == []
        words.clear()
        words.send_keys("axis0002")
        table.find_element(By.LINK_TEXT, "axis0002").click()
        assert browser.find_element(By.TAG_NAME, "h1").text == "Axis axis0002"
    finally:
        browser.quit()
