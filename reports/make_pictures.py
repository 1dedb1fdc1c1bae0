"""The pictures of the workbench in the docs: `python reports/make_pictures.py`; needs selenium and Chromium.

    python reports/make_pictures.py                                 docs/workbench/*.png, as they are committed
    python reports/make_pictures.py --folder /tmp/p --size 390x844  the same walk as a phone shows it

The walk is that of docs/workbench.md: two simulated logs of the reference motor with a hidden Stribeck friction and a
hidden cogging torque.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains

from pmsm_ctrl import Design, simulate

FOLDER = Path(__file__).resolve().parent.parent / "docs" / "workbench"
HIDDEN = (
    ("stribeck", {"dF_s": 0.008, "w_s": 8.0, "delta": 2.0}),
    ("cogging", {"a_s": 0.004, "a_c": 0.0, "order": 24.0}),
)
PATIENCE = 300.0  # s; without a cache the first fit compiles its code


def logs(folder: Path) -> list[Path]:
    """Write the two logs of the tutorial."""
    design = truth = Design.example("seed_motor")
    for effect, parameters in HIDDEN:
        truth = truth.with_effect(effect, parameters)
    return [
        simulate(design, "identification", truth=truth, seed=run).write_csv(folder / f"run_{run}.csv") for run in (1, 2)
    ]


class Walk:
    """A browser that goes through the steps and takes pictures."""

    def __init__(self, folder: Path, width: int, height: int) -> None:
        self.folder = folder
        options = webdriver.ChromeOptions()
        options.binary_location = shutil.which("chromium") or ""
        for word in ("headless=new", "no-sandbox", "disable-gpu", f"window-size={width},{height}"):
            options.add_argument(f"--{word}")
        self.driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(shutil.which("chromedriver")))
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)

    def until(self, script: str) -> None:
        """Wait until a script returns something true."""
        begin = time.monotonic()
        while not self.driver.execute_script(f"return {script}"):
            if time.monotonic() - begin > PATIENCE:
                raise SystemExit(f"waited {PATIENCE:g} s for: {script}")
            time.sleep(0.1)

    def press(self, identifier: str) -> None:
        """Press a button."""
        self.until(f"document.getElementById('{identifier}')?.disabled === false")
        self.driver.execute_script(f"document.getElementById('{identifier}').click()")

    def idle(self) -> None:
        """Wait until nothing is computed or drawn any more."""
        self.until("document.getElementById('status').hidden")
        time.sleep(1.0)

    def picture(self, name: str) -> None:
        """Keep what is on the screen."""
        self.folder.mkdir(parents=True, exist_ok=True)
        self.driver.save_screenshot(str(self.folder / f"{name}.png"))

    def go(self, address: str, files: list[Path], keep: Callable[[str], bool]) -> None:
        """Go through the four steps."""
        self.driver.get(address)
        self.until("document.body.dataset.ready === 'yes'")
        shots: list[tuple[str, Callable[[], Any]]] = [
            ("design", lambda: None),
            ("logs", lambda: self._load(files)),
            ("compare", self._compare),
            ("found", self._add),
            ("take", lambda: self.press("to-take")),
        ]
        for name, act in shots:
            act()
            self.idle()
            if name == "compare":
                first = self.driver.find_element("id", "candidate-a-0")
                ActionChains(self.driver).move_to_element(first).perform()
                time.sleep(1.0)
            self.driver.execute_script("scrollTo(0, 0)")
            if keep(name):
                self.picture(name)
        self.driver.quit()

    def _load(self, files: list[Path]) -> None:
        self.press("use-example")
        self.until("!document.getElementById('logs').hidden")
        self.driver.find_element("id", "log-file").send_keys("\n".join(map(str, files)))
        self.until("document.querySelectorAll('article.log .tile').length >= 12")

    def _compare(self) -> None:
        self.press("to-compare")
        self.until("document.querySelectorAll('#models li').length === 1")
        self.until("!!document.querySelector('[data-part=traces]').dataset.drawn")

    def _add(self) -> None:
        for count in (2, 3):
            self.press("add-a-0")
            self.until(f"document.querySelectorAll('#models li').length === {count}")
            self.idle()


def main(words: list[str]) -> None:
    """Serve a workbench and take its pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=None)
    parser.add_argument("--size", default="1165x760")
    asked = parser.parse_args(words)
    width, height = map(int, asked.size.split("x"))
    with tempfile.TemporaryDirectory() as scratch:
        files = logs(Path(scratch))
        command = [sys.executable, "-m", "pmsm_ctrl", "workbench", "--no-browser", "--folder", f"{scratch}/sessions"]
        server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        try:
            assert server.stdout is not None
            address = server.stdout.readline().split()[1]
            shown = {path.stem for path in FOLDER.glob("*.png")}
            walk = Walk(asked.folder or FOLDER, width, height)
            walk.go(address, files, lambda name: asked.folder is not None or name in shown)
        finally:
            server.terminate()
            server.wait()


if __name__ == "__main__":
    main(sys.argv[1:])
