"""A server of its own, and Debian's Chromium in place of a person; imported by the tests that drive it."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

webdriver = pytest.importorskip("selenium.webdriver", reason="SELENIUM ABSENT: pip install 'pmsm-ctrl[dev]'")
pytest.importorskip("bokeh", reason="BOKEH ABSENT: pip install 'pmsm-ctrl[workbench]'")
CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
if CHROMIUM is None or DRIVER is None:
    pytest.skip("CHROMIUM ABSENT: apt-get install chromium chromium-driver", allow_module_level=True)

NAME = "<script>alert(1)</script>"
SIZES, SIZE_NAMES = [(1280, 800), (390, 844)], ["1280x800", "390x844"]
WAIT = 300.0  # s; without a cache the first fit compiles its code


class Server:
    """A server in a process of its own."""

    def __init__(self, folder: Path, *words: str) -> None:
        command = [sys.executable, "-m", "pmsm_ctrl", "workbench", "--no-browser", "--folder", str(folder), *words]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True)
        assert self.process.stdout is not None
        self.address = self.process.stdout.readline().split()[1]

    def close(self) -> None:
        self.process.terminate()
        try:
            self.process.wait(20)
        except subprocess.TimeoutExpired:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()


class Person:
    """What somebody does with mouse and keyboard."""

    def __init__(self, width: int, height: int) -> None:
        options = webdriver.ChromeOptions()
        options.binary_location = CHROMIUM
        for word in (
            "headless=new",
            "no-sandbox",
            "disable-gpu",
            "disable-dev-shm-usage",
            f"window-size={width},{height}",
        ):
            options.add_argument(f"--{word}")
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        service = webdriver.ChromeService(DRIVER)
        self.driver = webdriver.Chrome(options=options, service=service)
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)

    def do(self, script: str, *arguments: Any) -> Any:
        return self.driver.execute_script(script, *arguments)

    def until(self, condition: Callable[[], Any], what: str) -> Any:
        begin = time.monotonic()
        while time.monotonic() - begin < WAIT:
            try:
                if found := condition():
                    return found
            except Exception as error:
                if "stale" not in str(error) and "no such element" not in str(error):
                    raise
            time.sleep(0.05)
        raise AssertionError(f"waited {WAIT:g} s for {what}; status: {self.text('status')}")

    def open(self, address: str) -> None:
        self.driver.get(address)
        self.until(lambda: self.do("return document.body.dataset.ready === 'yes'"), "the page")

    def element(self, identifier: str) -> Any:
        return self.driver.find_element("id", identifier)

    def press(self, identifier: str) -> None:
        self.until(lambda: self.element(identifier).is_enabled(), identifier)
        self.do("arguments[0].scrollIntoView({block: 'center'})", self.element(identifier))
        places = [-1.0]

        def still() -> bool:
            places.append(float(self.do("return arguments[0].getBoundingClientRect().y", self.element(identifier))))
            return places[-1] == places[-2]

        self.until(still, f"{identifier} to stand still")
        self.element(identifier).click()

    def text(self, identifier: str) -> str:
        return str(self.do("return document.getElementById(arguments[0])?.textContent || ''", identifier))

    def idle(self) -> None:
        quiet = "return fetch('state').then((r) => r.json()).then((s) => s.job === null)"
        self.until(lambda: self.do(quiet) and self.element("status").get_attribute("hidden") is not None, "quiet")

    def models(self) -> int:
        return int(self.do("return document.querySelectorAll('#models li:not(#without)').length"))

    def errors_of(self, row: str) -> list[float]:
        words = self.do("return [...document.querySelectorAll(`${arguments[0]} em`)].map((e) => e.textContent)", row)
        return [float(word.removesuffix(" %")) for word in words]

    def overhang(self) -> int:
        """Return by how many pixels the page is wider than the screen; a phone's innerWidth grows with the page."""
        return int(self.do("const root = document.documentElement; return root.scrollWidth - root.clientWidth"))

    def errors(self) -> list[str]:
        return [entry["message"] for entry in self.driver.get_log("browser") if entry["level"] == "SEVERE"]
