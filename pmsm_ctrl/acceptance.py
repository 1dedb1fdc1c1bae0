"""pytest plugin: ``pytest designs/`` runs every ``[[acceptance]]`` line of the designs as a test.

pytest loads it wherever the package is installed, and only there: ``python -m pmsm_ctrl.acceptance designs/`` is the
same with the pytest of this environment, or says that there is none. It imports heavy modules only for a design, and
ignores every TOML file without ``[[acceptance]]`` and ``[motor]``.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

try:
    import pytest
except ModuleNotFoundError as error:
    if error.name != "pytest":
        raise
    message = (
        f"acceptance: pytest is not installed beside pmsm-ctrl, in {sys.prefix}: {sys.executable} -m pip install "
        "pytest; a pytest of another environment does not know the designs"
    )
    if __name__ == "__main__":
        print(f"pmsm-ctrl: {message}", file=sys.stderr)
        sys.exit(2)
    raise ModuleNotFoundError(message, name="pytest") from None

from pmsm_ctrl.errors import PmsmCtrlError

if TYPE_CHECKING:
    from pmsm_ctrl.compensate import Verdict
    from pmsm_ctrl.design import Acceptance, Design

__all__ = ["AcceptanceItem", "DesignFile"]

PLOTS = "reports/acceptance"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option for the folder of the plots."""
    parser.getgroup("pmsm_ctrl", "acceptance of drive designs").addoption(
        "--acceptance-plots",
        metavar="FOLDER",
        default=None,
        help=f"folder for the plots of failed acceptance tests (default: {PLOTS} below the root folder)",
    )


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> DesignFile | None:
    """Take TOML files with an acceptance in."""
    if file_path.suffix == ".toml" and _has_acceptance(file_path):
        return DesignFile.from_parent(parent, path=file_path)
    return None


def _has_acceptance(path: Path) -> bool:
    try:
        text = path.read_text(encoding="utf-8")
        if "acceptance" not in text:
            return False
        data = tomllib.loads(text)
    except (OSError, UnicodeDecodeError):
        return False
    except (tomllib.TOMLDecodeError, RecursionError):  # a damaged design must not be skipped
        return re.search(r"^\[\[acceptance\]\]", text, re.MULTILINE) is not None
    return "acceptance" in data and "motor" in data


class AcceptanceFailedError(Exception):
    """A metric beyond its limit; the message is the whole report."""


class DesignFile(pytest.File):
    """A design with an acceptance; each of its lines is a test."""

    def collect(self) -> Iterable[AcceptanceItem]:
        """Yield a test a line."""
        return self._items()

    def _items(self) -> Iterator[AcceptanceItem]:
        from pmsm_ctrl.design import Design

        try:
            design = Design.read(self.path)
        except PmsmCtrlError as error:
            raise self.CollectError(str(error)) from None
        names: dict[str, int] = {}
        for wanted in design.acceptance:
            off = "" if wanted.factor == 1.0 else f", parameters {100.0 * (wanted.factor - 1.0):+g} %"
            name = f"{wanted.scenario}{off}: {wanted.metric} <= {wanted.limit:g}"
            names[name] = names.get(name, 0) + 1
            if names[name] > 1:
                name += f" ({names[name]})"
            yield AcceptanceItem.from_parent(self, name=name, design=design, wanted=wanted)


class AcceptanceItem(pytest.Item):
    """One line of an acceptance."""

    def __init__(self, *, design: Design, wanted: Acceptance, **rest: Any) -> None:
        super().__init__(**rest)
        self.design, self.wanted = design, wanted

    def runtest(self) -> None:
        """Simulate and compare.

        Raises
        ------
        AcceptanceFailedError
            When the metric is beyond its limit.
        """
        from pmsm_ctrl.compensate import accept
        from pmsm_ctrl.compensate.notices import sentence

        verdict = accept(self.design, self.wanted)
        if not verdict.passed:
            raise AcceptanceFailedError(f"{sentence(verdict)}\ndesign: {self.path}\nplot: {self._plot(verdict)}")

    def _plot(self, verdict: Verdict) -> str:
        """Save the plot of a failure; return its path, or why there is none."""
        from pmsm_ctrl.compensate.figures import acceptance

        chosen = self.config.getoption("--acceptance-plots")
        folder = Path(chosen) if chosen else self.config.rootpath / PLOTS
        stem = re.sub(r"[^\w.+-]+", "_", f"{self.path.stem} {self.name}").strip("._")
        try:
            folder.mkdir(parents=True, exist_ok=True)
            path = folder / f"{stem}.svg"
            acceptance(verdict).savefig(path)
        except OSError as error:
            return f"none, because {folder} cannot be written ({error.strerror})"
        return str(path)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Return what a reader needs: the report of a failure or the line of an error, without a traceback."""
        if isinstance(excinfo.value, AcceptanceFailedError | PmsmCtrlError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, None, str]:
        """Return file and name for the header of a failure."""
        return self.path, None, f"{self.path.name}: {self.name}"


if __name__ == "__main__":
    sys.exit(pytest.main(sys.argv[1:]))
