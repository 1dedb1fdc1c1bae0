"""What a person can press beside the straight way: the form, the menus of a foreign file, windows, order, downloads."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.unit.workbench.person import SIZE_NAMES, SIZES, Person, Server

SHEET = {
    "pole_pairs": ("4", ""), "torque_constant": ("1.46", "N m/A rms"), "resistance": ("38", "Ohm line"),
    "inductance": ("98.32", "mH line"), "inertia": ("heavy", "kg cm2"), "current_limit": ("3", "A rms"),
}  # fmt: skip


def chosen(person: Person, identifier: str, value: str) -> None:
    """Choose an entry of a menu, as the keyboard would."""
    person.do("const menu = document.getElementById(arguments[0]); menu.value = arguments[1];"
              "menu.dispatchEvent(new Event('change', { bubbles: true }))", identifier, value)  # fmt: skip
    assert person.do("return document.getElementById(arguments[0]).value", identifier) == value


def loaded(person: Person, folder: Path) -> None:
    """Come to the step Compare with the two logs."""
    person.element("toml").send_keys(str(folder / "design.toml"))
    person.until(lambda: person.element("log-file").is_displayed(), "step 2")
    person.element("log-file").send_keys("\n".join(str(path) for path in sorted(folder.glob("*.csv"))))
    person.until(lambda: person.do("return document.querySelectorAll('article.log .tile').length >= 6"), "two logs")
    person.idle()
    person.press("to-compare")
    person.until(lambda: person.models() == 1, "the base parameters")
    person.idle()


@pytest.mark.slow
def test_the_datasheet_a_foreign_file_and_a_window(person: Person, server: Server, tmp_path: Path) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    person.open(server.address)
    person.do("document.getElementById('sheet').open = true")
    for key, (value, unit) in SHEET.items():
        person.element(f"q-{key}").send_keys(value)
        if unit:
            chosen(person, f"u-{key}", unit)
    person.press("use-form")
    person.until(lambda: "a number with its unit" in person.text("e-inertia"), "the error at its field")
    assert person.driver.switch_to.active_element.get_attribute("id") == "q-inertia"
    assert person.element("q-resistance").get_attribute("value") == "38"
    person.element("q-inertia").clear()
    person.element("q-inertia").send_keys("0.9")
    person.press("use-form")
    person.until(lambda: person.element("log-file").is_displayed(), "step 2")
    t = np.arange(400) / 100.0
    rows = zip(t, 573.0 * np.sin(2 * t), np.sign(np.cos(2 * t)), strict=True)
    path = tmp_path / "odd.csv"
    path.write_text("alpha,beta,gamma\n" + "".join(f"{a:.4f},{b:.4f},{c:.1f}\n" for a, b, c in rows), encoding="utf-8")
    person.element("log-file").send_keys(str(path))
    person.until(lambda: person.do("return !!document.getElementById('apply-log1')"), "the menus")
    for channel, (column, unit) in {"t": ("1", "s"), "omega": ("2", "rpm"), "i_q": ("3", "A rms")}.items():
        chosen(person, f"c-log1-{channel}", column)
        chosen(person, f"u-log1-{channel}", unit)
    person.press("apply-log1")
    person.until(lambda: person.do("return document.querySelectorAll('article.log .tile').length") == 2, "two traces")
    assert "-60 … 60" in person.text("logs")  # 573 rpm
    person.idle()
    picture = person.driver.find_element("css selector", "svg.span")
    width = picture.size["width"]
    drag = ActionChains(person.driver).move_to_element_with_offset(picture, -width // 4, 0).click_and_hold()
    drag.move_by_offset(width // 4, 0).release().perform()
    person.until(lambda: float(person.element("from-log1").get_attribute("value")) > 0.5, "the window")
    start, stop = (float(person.element(f"{end}-log1").get_attribute("value")) for end in ("from", "to"))
    assert start == pytest.approx(1.0, abs=0.05)
    assert stop == pytest.approx(2.0, abs=0.05)
    assert [one for one in person.errors() if " 422 " not in one] == []  # the refused form


@pytest.mark.slow
def test_a_preview_the_order_a_stop_and_the_downloads(
    person: Person, server: Server, folder: Path, tmp_path: Path
) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    person.open(server.address)
    loaded(person, folder)
    asked = "return performance.getEntriesByType('resource').filter((one) => one.name.includes('view/preview')).length"
    assert person.do(asked) == 0
    ActionChains(person.driver).move_to_element(person.element("candidate-a-0")).perform()
    person.until(lambda: person.do(asked) == 1, "the curve over the residual")
    drawn = "return Number(document.querySelector('[data-part=traces]').dataset.drawn)"
    for over in ("acceleration [rad/s²]", "order of a turn", "speed [rad/s]"):
        count = person.do(drawn)
        chosen(person, "over", over)
        person.until(lambda count=count: person.do(drawn) > count, f"the residual over {over}")
    person.do(  # pressed as soon as it is there
        "new MutationObserver(() => document.getElementById('stop')?.click())"
        ".observe(document.body, { childList: true, subtree: true })"
    )
    person.press("find")
    person.until(lambda: "was stopped" in person.text("status"), "the end of the search")
    assert person.models() == 1
    person.press("add-a-0")
    person.until(lambda: person.models() == 2, "the first effect")
    person.idle()
    person.do("document.getElementById('refused').open = true")
    person.press("add-b-0")
    person.until(lambda: person.models() == 3, "the second effect")
    person.idle()
    names = "return [...document.querySelectorAll('.added label span')].map((one) => one.textContent)"
    before = person.do(names)
    person.driver.find_element("css selector", ".added button[title='Add earlier']").click()
    person.until(lambda: person.do(names) == before[::-1], "the other order")
    person.idle()
    person.press("to-take")
    person.driver.execute_cdp_cmd("Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(tmp_path)})
    files: dict[str, Any] = {"design": ".toml", "report": ".html", "json": ".json", "script": ".py"}
    for kind, suffix in files.items():
        person.press(f"take-{kind}")
        person.until(lambda suffix=suffix: list(tmp_path.glob(f"*{suffix}")), f"the {kind}")
        files[kind] = next(tmp_path.glob(f"*{suffix}")).read_text(encoding="utf-8")
    added = {effect["id"] for effect in tomllib.loads(files["design"])["effects"]} - {"coulomb", "viscous"}
    assert len(added) == 2
    assert json.loads(files["json"])["schema"].startswith("pmsm-ctrl/")
    assert all(one in files["script"] for one in added)
    compile(files["script"], "steps.py", "exec")
    assert files["report"].startswith("<!DOCTYPE html>")
    assert person.errors() == []


@pytest.mark.slow
@pytest.mark.parametrize("person", SIZES, indirect=True, ids=SIZE_NAMES)
def test_the_pages_of_the_gallery_without_scripts_and_printed(person: Person, project_root: Path) -> None:
    """The figures are there, nothing waits for a script, and what is folded on the screen is printed."""
    person.driver.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": True})
    for page in sorted((project_root / "reports" / "gallery").glob("*.html")):
        person.driver.get(page.as_uri())
        heights = person.do("return [...document.querySelectorAll('.hero svg')].map((e) => e.clientHeight)")
        assert heights, page.stem
        assert min(heights) > 100, page.stem
        assert not person.do("return [...document.querySelectorAll('.live')].some((e) => e.clientHeight > 0)"), (
            page.stem
        )
        assert person.overhang() <= 0, page.stem
        folded = "return [...document.querySelectorAll('details:not([open]) table')].map((e) => e.checkVisibility())"
        assert not any(person.do(folded)), page.stem
        person.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
        printed = person.do(folded)
        assert printed, page.stem
        assert all(printed), page.stem
        person.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
    assert person.errors() == []
