"""What a candidate's columns tell, in the order in which it is asked."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl.diagnose import judging
from pmsm_ctrl.diagnose.judging import judge_trial
from pmsm_ctrl.diagnose.policy import POLICY
from pmsm_ctrl.diagnose.refusal import Reason, Refusal
from pmsm_ctrl.diagnose.search import Trial

STRUCTURE = SimpleNamespace(has_memory=True, never_minor=lambda shape: False)
CANDIDATE: Any = SimpleNamespace(effect=SimpleNamespace(structure=STRUCTURE))
PART, WHOLE = 0.001, 0.5  # of the balance; and of the residual above its noise floor


def trial(size: float) -> Trial:
    group: Any = SimpleNamespace(shape={}, size=size)
    judge: Any = (None, None)
    return Trial(CANDIDATE, group, 100.0, 100.0, 0.0, np.ones(1), np.ones(1), judge, plain_gain=100.0)


class ReachedError(Exception):
    """Cross-validation was reached."""


@pytest.mark.parametrize("as_a_whole", [True, False])
def test_an_effect_that_is_too_small_in_part_is_sized_as_a_whole(
    monkeypatch: pytest.MonkeyPatch, as_a_whole: bool
) -> None:
    def confirmed(fit: Any, trial: Any) -> Any:
        raise ReachedError

    part, whole = trial(PART), trial(WHOLE)
    monkeypatch.setattr(judging, "contribution", lambda fit, one: one.group.size)
    monkeypatch.setattr(judging, "excess_of", lambda solved, one, gain: (one.group.size, one.group.size))
    monkeypatch.setattr(judging, "has_own_order", lambda fit, one: False)
    monkeypatch.setattr(judging, "sized", lambda fit, one, share: whole if as_a_whole else one)
    monkeypatch.setattr(judging, "cross_validated", confirmed)
    fit: Any = SimpleNamespace(plain=None, solved=None, accepted=())
    if as_a_whole:
        with pytest.raises(ReachedError):
            judge_trial(fit, part, 0.0, POLICY)
        return
    found = judge_trial(fit, part, 0.0, POLICY)
    assert isinstance(found, Refusal)
    assert found.reason is Reason.TOO_SMALL
