"""The table of physics checks: each check states what it found and what the closed form says."""

from __future__ import annotations

from collections.abc import Callable

import pytest

ROWS: list[tuple[str, float, float, str]] = []


@pytest.fixture
def checked() -> Callable[..., None]:
    """Return a function that notes one figure and asserts it: ``checked("what", found, expected, rel=0.01)``."""

    def note(
        what: str,
        found: float,
        expected: float = 0.0,
        *,
        rel: float | None = None,
        at_most: float | None = None,
        at_least: float | None = None,
    ) -> None:
        if at_most is not None:
            ROWS.append((what, found, at_most, "at most"))
            assert found <= at_most, what
        elif at_least is not None:
            ROWS.append((what, found, at_least, "at least"))
            assert found >= at_least, what
        else:
            assert rel is not None
            ROWS.append((what, found, expected, f"within {100 * rel:g} %"))
            assert found == pytest.approx(expected, rel=rel), what

    return note


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    if not config.getoption("--physics-table") or not ROWS:
        return
    terminalreporter.write_line("| check | simulated | closed form or bound | tolerance |")
    terminalreporter.write_line("|---|---|---|---|")
    for what, found, expected, how in ROWS:
        terminalreporter.write_line(f"| {what} | {found:.6g} | {expected:.6g} | {how} |")
