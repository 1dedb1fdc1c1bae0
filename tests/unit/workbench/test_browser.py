"""The workbench as a person uses it: Debian's Chromium goes through the steps; errors on its console fail the test."""

from __future__ import annotations

import os
import re
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pmsm_ctrl import Design, Log, simulate
from pmsm_ctrl.simulate import scenario
from tests.axe import violations
from tests.benchmarks.workbench import memory_of, written
from tests.unit.workbench.person import NAME, SIZE_NAMES, SIZES, Person, Server

DROPPED = """const files = new DataTransfer();
files.items.add(new File(["t,theta"], "a.csv"));
const dropped = new DragEvent("drop", {dataTransfer: files, bubbles: true, cancelable: true});
document.querySelector("main").dispatchEvent(dropped);"""


def through(person: Person, folder: Path, address: str) -> None:
    """From nothing to a design with the missing effect."""
    person.open(address)
    person.do(DROPPED)  # before there is a design: it is said and not swallowed
    person.until(
        lambda: "A design comes first" in person.text("status"), "the answer to a log that is dropped too early"
    )
    person.element("toml").send_keys(str(folder / "design.toml"))
    person.until(lambda: person.element("log-file").is_displayed(), "step 2")
    person.element("log-file").send_keys("\n".join(str(path) for path in sorted(folder.glob("*.csv"))))
    person.until(lambda: person.do("return document.querySelectorAll('article.log .tile').length >= 6"), "two logs")
    person.idle()
    shown = "return [...document.querySelectorAll('input[type=file]')].every((e) => e.offsetWidth <= 1)"
    assert person.do(shown), "the browser says 'No file chosen' there"
    assert person.do("return document.querySelectorAll('img, main script').length") == 0
    assert "<img src=x onerror=alert(1)>.csv" in person.text("logs")
    assert NAME in person.text("subject")
    assert "the second as Held out" in person.text("roles-note")
    person.press("to-compare")
    person.until(lambda: person.models() == 1, "the base parameters")
    person.until(lambda: person.do("return !!document.querySelector('[data-part=traces]').dataset.drawn"), "traces")
    person.idle()
    assert person.overhang() <= 0
    first = person.do("return document.querySelector('[data-effect]').dataset.effect")
    assert first in ("quadratic_drag", "viscous_power")
    person.press("add-a-0")
    person.until(lambda: person.models() == 2, "the first effect")
    person.idle()


@pytest.mark.slow
def test_a_stranger_finds_the_missing_effect(person: Person, server: Server, folder: Path) -> None:
    through(person, folder, server.address)
    drawn = "return Number(document.querySelector('[data-part=traces]').dataset.drawn)"
    before = person.do(drawn)
    words = person.do("return [...document.querySelectorAll('.detail')].map((e) => e.textContent).join(' ')")
    assert "Look-alikes in general: " in words
    assert "_" not in re.sub(r"\b\w_\w+", "", words), "a look-alike by its id"  # symbols such as a_s stay
    assert "low-passed at" in person.text("models-note"), "why one log has two errors"
    assert "held out: b.csv" in person.text("models-note"), "of which log an error is"
    said = person.do("return document.querySelector('[data-part=models] [role=status]').textContent")
    assert re.search(r"drag: error [\d.]+ % on the fitted <img .*, [\d.]+ % on the held-out b\.csv$", said)
    assert "quadratic drag coefficient" in person.do("return document.querySelector('.added').textContent")
    closed = person.do("return [...document.querySelectorAll('#closed li b')].map((e) => e.textContent)")
    assert closed
    assert all(title in person.do("return document.querySelector('#closed summary').textContent") for title in closed)
    person.do("document.querySelector('.zoom button').click()")
    person.until(lambda: person.do(drawn) > before, "the zoom")
    assert violations(person.driver) == []
    for record in (0, 1):  # the fitted one, and the one that was held out
        person.do("const r = document.getElementById('record'); r.selectedIndex = arguments[0];"
                  "r.dispatchEvent(new Event('change', { bubbles: true }))", record)  # fmt: skip
        with_all, before = person.errors_of("#models li:last-child"), person.do(drawn)
        person.press("switch-0")
        without = person.errors_of("#without")
        assert len(without) == len(with_all) == 2, "fitted and held out"
        assert all(off > 1.2 * on for off, on in zip(without, with_all, strict=True))
        person.until(lambda before=before: person.do(drawn) > before, "the residual without the effect")
        person.press("switch-0")
        assert not person.errors_of("#without")
    person.press("to-take")
    assert "drag" in person.text("take")
    person.driver.refresh()  # nothing is lost
    person.until(lambda: person.do("return document.body.dataset.ready === 'yes'"), "the page again")
    person.do("document.querySelector('[data-step=compare]').click()")
    person.until(lambda: person.models() == 2, "the models again")
    assert person.overhang() <= 0
    assert person.errors() == []


@pytest.mark.slow
@pytest.mark.parametrize("person", [(390, 844)], indirect=True)
def test_the_steps_on_a_phone(person: Person, server: Server, folder: Path) -> None:
    through(person, folder, server.address)
    for step in ("design", "logs", "compare", "take"):
        person.do("document.querySelector(`[data-step=${arguments[0]}]`).click()", step)
        assert person.overhang() <= 0, step
        assert violations(person.driver) == [], step
    assert person.errors() == []


@pytest.mark.slow
@pytest.mark.parametrize("person", SIZES, indirect=True, ids=SIZE_NAMES)
def test_the_pages_of_the_gallery_are_accessible_and_as_wide_as_the_screen(person: Person, project_root: Path) -> None:
    """Drawn by their scripts, and all that is folded unfolded; a table or a figure scrolls in its own frame."""
    for page in sorted((project_root / "reports" / "gallery").glob("*.html")):
        person.driver.get(page.as_uri())
        assert violations(person.driver) == [], page.stem
        person.until(lambda: person.do("return !document.querySelector('.live[hidden]')"), "the traces")
        person.do("for (const each of document.querySelectorAll('details')) each.open = true")
        assert person.overhang() <= 0, page.stem
        assert person.errors() == [], page.stem


@pytest.mark.slow
def test_the_steps_by_keyboard(person: Person, server: Server, folder: Path) -> None:
    """From nothing to a design with the missing effect, and never a click."""
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.keys import Keys

    person.open(server.address)

    def tab_to(identifier: str) -> Any:
        person.until(lambda: person.element(identifier).is_enabled(), identifier)
        for _ in range(150):
            active = person.driver.switch_to.active_element
            if active.get_attribute("id") == identifier:
                outline = person.do("return getComputedStyle(document.activeElement).outlineStyle")
                assert outline != "none", f"nobody sees that {identifier} has the focus"
                return active
            ActionChains(person.driver).send_keys(Keys.TAB).perform()  # to an element, a file input takes it for a name
        raise AssertionError(f"{identifier} is not reached with the tabulator")

    tab_to("toml").send_keys(str(folder / "design.toml"))
    person.until(lambda: person.element("log-file").is_displayed(), "step 2")
    tab_to("log-file").send_keys("\n".join(str(path) for path in sorted(folder.glob("*.csv"))))
    person.until(lambda: person.do("return document.querySelectorAll('article.log .tile').length >= 6"), "two logs")
    person.idle()
    tab_to("to-compare").send_keys(Keys.ENTER)
    person.until(lambda: person.models() == 1, "the base parameters")
    person.idle()
    tab_to("add-a-0").send_keys(Keys.ENTER)
    person.until(lambda: person.models() == 2, "the first effect")
    person.idle()
    tab_to("undo").send_keys(Keys.ENTER)
    person.until(lambda: person.models() == 1, "the effect undone")
    person.idle()
    assert "mean square" in person.text("share-note"), "that the share is none of the rms error"
    assert person.element("find").get_attribute("class") == "main"
    tab_to("find").send_keys(Keys.ENTER)
    person.until(lambda: person.models() == 2, "the search")
    person.idle()
    assert person.element("find").get_attribute("class") == "", "nothing is left to find"
    alike = person.do("return [...document.querySelectorAll('.added .same, .added .apart')].map((e) => e.textContent)")
    assert alike
    assert all(re.match("This log cannot tell it from: |Told apart on this log from: ", text) for text in alike)
    tab_to("to-take").send_keys(Keys.ENTER)
    assert "drag" in person.text("take")
    assert person.errors() == []


@pytest.mark.slow
def test_a_killed_worker_is_a_message_and_not_the_end(person: Person, tmp_path: Path, folder: Path) -> None:
    server = Server(tmp_path / "sessions")
    try:
        through(person, folder, server.address)
        found = subprocess.run(["pgrep", "-P", str(server.process.pid)], capture_output=True, text=True, check=True)
        for child in found.stdout.split():
            command = Path(f"/proc/{child}/cmdline").read_bytes()
            if b"spawn_main" in command:
                os.kill(int(child), signal.SIGKILL)
        person.press("undo")
        person.until(lambda: "has ended" in person.text("status"), "the message")
        person.driver.find_element("css selector", "#status button").click()
        person.press("undo")
        person.until(lambda: person.models() == 1, "the step repeated")
        server.process.kill()  # now the server itself
        server.process.wait()
        person.press("find")
        person.until(lambda: "does not answer" in person.text("status"), "the message")
    finally:
        server.close()
    again = Server(tmp_path / "sessions")
    try:
        session = next(path.parent.name for path in (tmp_path / "sessions").glob("*/session.json"))
        person.open(f"{again.address}s/{session}/")
        person.until(lambda: person.models() == 1, "the session after the restart")
    finally:
        again.close()


@pytest.mark.slow
def test_two_tabs_do_not_disturb_each_other(person: Person, server: Server, folder: Path) -> None:
    through(person, folder, server.address)
    first = person.driver.current_window_handle
    person.driver.switch_to.new_window("tab")
    person.open(server.address)
    person.press("use-example")
    person.until(lambda: person.text("subject") == "seed_motor", "the other design")
    person.driver.switch_to.window(first)
    assert NAME in person.text("subject")
    assert person.models() == 2
    assert person.errors() == []


@pytest.mark.slow
def test_a_file_of_200_megabytes_is_shown_and_the_server_stays_small(person: Person, tmp_path: Path) -> None:
    """The browser sends it, the server writes it to disk as it comes, and the session's process reads it."""
    path = written(tmp_path / "large.csv", 200.0)
    assert path.stat().st_size > 190e6
    server = Server(tmp_path / "sessions")
    try:
        person.open(server.address)
        person.press("use-example")
        person.until(lambda: person.element("log-file").is_displayed(), "step 2")
        before = memory_of(server.process.pid)
        person.element("log-file").send_keys(str(path))
        tiles = "return [...document.querySelectorAll('article.log .tile path, article.log .tile polyline')].length"
        person.until(lambda: person.do(tiles) >= 3, "the traces")
        assert memory_of(server.process.pid) - before < 60.0
        assert person.errors() == []
    finally:
        server.close()


@pytest.mark.slow
@pytest.mark.parametrize("person", SIZES, indirect=True, ids=SIZE_NAMES)
def test_emps_after_a_file_that_is_no_log(
    person: Person, server: Server, tmp_path: Path, measured: Callable[[str], Path]
) -> None:
    """The measured axis, from its two files."""
    logs = [measured(f"emps/{name}.mat") for name in ("DATA_EMPS", "DATA_EMPS_PULSES")]
    bad = tmp_path / "notes.csv"
    bad.write_text("these are\nno numbers, at all\n", encoding="utf-8")
    person.open(server.address)
    person.do("document.querySelector('#example').value = 'emps'")
    person.press("use-example")
    person.until(lambda: person.element("log-file").is_displayed(), "step 2")
    person.element("log-file").send_keys(str(bad))
    person.until(
        lambda: person.do("return document.querySelectorAll('article.log .complaint').length") == 1, "the error"
    )
    assert not person.element("to-compare").is_enabled()
    person.do("[...document.querySelectorAll('article.log button')].find((b) => b.textContent === 'Remove').click()")
    person.until(lambda: person.do("return document.querySelectorAll('article.log').length") == 0, "no log")
    person.element("log-file").send_keys("\n".join(map(str, logs)))
    person.until(lambda: person.do("return document.querySelectorAll('article.log .tile').length >= 6"), "two logs")
    person.idle()
    person.press("to-compare")
    person.until(lambda: person.models() == 1, "the base parameters")
    person.press("find")
    person.until(lambda: "missing effect" in person.text("verdict"), "the search")
    assert "viscous" in person.text("verdict").lower()
    errors = [person.errors_of(f"#models li:nth-child({k})") for k in (1, person.models())]
    assert all(after < 0.7 * before for before, after in zip(*errors, strict=True)), "fitted and held out"
    assert person.overhang() <= 0
    assert person.errors() == []


@pytest.mark.slow
@pytest.mark.parametrize("person", SIZES, indirect=True, ids=SIZE_NAMES)
def test_the_friction_of_a_growing_file_stands_in_its_band(person: Person, tmp_path: Path, designs: Path) -> None:
    """The axis has F_c 0.0213 N m and F_v 0.000168 N m s/rad; the design that the tracker begins with, half of both."""
    axis = Design.read(designs / "seed_motor.toml")
    half = axis.with_effect("coulomb", {"F_c": 0.0107}).with_effect("viscous", {"F_v": 8.4e-5})
    (tmp_path / "half.toml").write_text(half.to_toml(), encoding="utf-8")
    log = simulate(axis, scenario("triangle", axis, speed=150.0, period=2.0), seed=1).between(0.0, 6.0)
    path = Log({name: log[name] for name in ("t", "theta", "i_q")}).write_csv(tmp_path / "whole.csv")
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    source = tmp_path / "<img src=x onerror=alert(1)>.csv"
    server = Server(tmp_path / "sessions", str(tmp_path / "half.toml"), "--live", str(source))
    try:
        person.open(server.address)
        person.until(lambda: "Waiting for samples" in person.text("live"), "the step Live")
        for part, reached in ((lines[:3000], "2."), (lines[3000:], "5.")):
            with open(source, "a", encoding="utf-8") as file:
                file.writelines(part)
            person.until(lambda reached=reached: person.text("live-t").startswith(reached), f"{reached} s")
        person.until(lambda: "No sample for" in person.text("live"), "the end of the file")
        for name, true in (("F_c", 0.0213), ("F_v", 0.000168)):
            value, _, band, *_ = person.text(f"live-{name}").split()
            assert abs(float(value) - true) < 2.0 * float(band) < 0.25 * true, name
        assert int(person.do("return document.querySelector('[data-part=bands]').dataset.drawn")) >= 2
        assert source.name in person.text("live")
        assert person.do("return document.querySelectorAll('img').length") == 0
        assert person.overhang() <= 0
        assert violations(person.driver) == []
        assert person.errors() == []
    finally:
        server.close()
