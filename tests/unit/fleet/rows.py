"""Rows of a fleet without logs: what is true of each axis is known."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta

import numpy as np

from pmsm_ctrl.fleet.store import Row

FIRST = datetime(2026, 3, 1, 22, tzinfo=UTC)
DONE = "done"


def of_record(
    axis: str, day: int, F_c: float, *, stderr: float = 1e-4, effects: dict[str, float] | None = None,
    verdict: str = "", status: str = DONE, text: str = "", temperature: float | None = None,
    whole: tuple[float, float] | None = None,
) -> Iterator[Row]:  # fmt: skip
    """Yield the rows of one record; `effects` holds p-values by name, `whole` F_c and its error beside these."""
    effects, when, number = effects or {}, FIRST + timedelta(days=day), iter(range(100))

    def row(source: str, kind: str, name: str, **values: object) -> Row:
        record = f"logs/{axis}/{when:%Y-%m-%d}.csv"
        return Row(f"{axis}-{day}", next(number), axis, "", record, when, when, source, kind, name, **values)  # type: ignore[arg-type]

    if status == DONE:
        yield row("identify", "parameter", "F_c", value=F_c, stderr=stderr, unit="N m", nominal=0.02)
        if temperature is not None:
            yield row("import", "quantity", "temperature", value=temperature, unit="degC")
        word = verdict or ("effects_missing" if effects else "consistent")
        yield row("diagnose", "verdict", word, text=text)
        for name, p in effects.items():
            yield row("diagnose", "finding", name, p_value=p, unit="1")
        if whole is not None:
            yield row("diagnose", "deviation", "F_c", value=whole[0], stderr=whole[1], unit="N m", nominal=0.02)
    yield row("fleet", "status", status, text=text)


def a_fleet(axes: int, records: int, seed: int) -> list[Row]:
    """Return a fleet: axis 1 lacks cogging from the middle on, axis 2 drifts, axis 3 steps, axis 4 has bad logs."""
    rng, out = np.random.default_rng(seed), []
    for k in range(1, axes + 1):
        level = 0.02 * (1.0 + 0.03 * rng.standard_normal())
        for day in range(records):
            F_c = level * (1.0 + 0.01 * rng.standard_normal())
            F_c *= 1.0 + 0.03 * day if k % 20 == 2 else 1.15 if k % 20 == 3 and day >= records // 2 else 1.0
            shows = k % 20 == 1 and day >= records // 2
            bad = k % 20 == 4 and day % 3 == 0
            out += of_record(
                f"axis{k:04d}", day, F_c + 1e-4 * rng.standard_normal(), effects={"cogging": 1e-9} if shows else {},
                status="failed" if bad else DONE, text="empty" if bad else "",
            )  # fmt: skip
    return out
