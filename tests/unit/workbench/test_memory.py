"""Kept fits are bounded by the bytes of their arrays, which are counted once."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import pytest

from pmsm_ctrl.workbench import tasks
from pmsm_ctrl.workbench.memory import array_bytes


@dataclass(frozen=True)
class Held:
    values: np.ndarray
    more: object = None


def test_arrays_are_counted_once_and_views_as_what_they_hold() -> None:
    shared = np.zeros(1000)
    own = np.zeros((10, 5), dtype=np.float32)
    first = Held(shared, {"a": [own, (own, "text")]})
    assert array_bytes([first]) == 8000 + 200
    assert array_bytes([first, Held(shared[10:20]), shared.reshape(10, 100)]) == 8000 + 200
    assert array_bytes([Held(own, MappingProxyType({"b": shared}))]) == 8200
    circle: list[object] = [shared]
    circle.append(circle)
    assert array_bytes(circle) == 8000


def test_the_oldest_fits_go_when_the_bytes_are_used_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tasks, "MOST_BYTES", 25_000)
    kept: OrderedDict[str, object] = OrderedDict()
    for k in range(6):
        kept[str(k)] = Held(np.full(1000, float(k)))
        tasks.forget(kept)
    assert list(kept) == ["3", "4", "5"]
    kept["large"] = Held(np.zeros(10_000))
    tasks.forget(kept)
    assert list(kept) == ["large"]  # the last one stays, however large: it is on the screen
