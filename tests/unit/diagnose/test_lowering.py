"""An effect that does not lower the error of the written design has no name, whatever its fit gains."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from pmsm_ctrl.diagnose import written
from pmsm_ctrl.diagnose.policy import POLICY
from pmsm_ctrl.diagnose.refusal import Reason
from pmsm_ctrl.diagnose.selection import Selection


def found(monkeypatch: pytest.MonkeyPatch, *left: float, noise: float = 0.01) -> Selection:
    """Return what is left of a selection whose designs have these errors."""
    names = "abc"[: len(left) - 1]
    fits: Any = tuple(SimpleNamespace(accepted=tuple(names[:k])) for k in range(len(left)))
    steps: Any = tuple(SimpleNamespace(trial=name) for name in names)
    case: Any = SimpleNamespace(
        believed=object(), policy=POLICY, record=None, fit=lambda accepted: SimpleNamespace(accepted=accepted)
    )
    monkeypatch.setattr(written, "noise_floor", lambda *_: {"torque": {"rms": noise}})
    monkeypatch.setattr(written, "_as_compared", lambda *_: [(error, 1.0) for error in left])
    monkeypatch.setattr(written, "name_of", lambda trial: trial)
    return written.lowering(case, Selection(fits, steps))


@pytest.mark.parametrize(
    ("left", "kept"),
    [
        ((0.10, 0.08), "a"),
        ((0.10, 0.10), "a"),  # a dead time has no part in the torque
        ((0.10, 0.11), ""),
        ((0.10, 0.08, 0.09), "a"),
        ((0.10, 0.11, 0.12), ""),
        ((0.10, 0.11, 0.05), "ab"),  # two that stand for each other
    ],
)
def test_last_effects_that_raise_the_error_go(
    monkeypatch: pytest.MonkeyPatch, left: tuple[float, ...], kept: str
) -> None:
    selection = found(monkeypatch, *left)
    assert "".join(selection.fit.accepted) == "".join(step.trial for step in selection.steps) == kept  # type: ignore[misc]
    gone = "abc"[len(kept) : len(left) - 1]
    assert {name: why.reason for name, why in selection.refused.items()} == dict.fromkeys(gone, Reason.BALANCE_WORSE)


@pytest.mark.parametrize(("noise", "kept"), [(0.08, "a"), (0.07, "")])
def test_where_most_of_what_is_left_is_noise_it_tells_nothing(
    monkeypatch: pytest.MonkeyPatch, noise: float, kept: str
) -> None:
    assert "".join(found(monkeypatch, 0.10, 0.11, noise=noise).fit.accepted) == kept
