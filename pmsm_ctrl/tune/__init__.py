"""Control design with python-control: from datasheet to margins, checked on the sampled drive.

python-control takes more than a second to import, so what needs it is loaded on first use.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from pmsm_ctrl.tune import present as _present  # noqa: F401 - registers the results
from pmsm_ctrl.tune.requirements import Requirements, Specification
from pmsm_ctrl.tune.result import Tuning, UnstableLoopError

if TYPE_CHECKING:
    from pmsm_ctrl.tune.linearise import Linearisation, OperatingPoint, linearise
    from pmsm_ctrl.tune.margins import Margins, margins
    from pmsm_ctrl.tune.optimise import optimise
    from pmsm_ctrl.tune.proof import Proof, prove
    from pmsm_ctrl.tune.tuning import assess, tune

__all__ = [
    "Linearisation", "Margins", "OperatingPoint", "Proof", "Requirements", "Specification", "Tuning",
    "UnstableLoopError", "assess", "linearise", "margins", "optimise", "prove", "tune",
]  # fmt: skip

_HOME = {
    "Linearisation": "linearise", "OperatingPoint": "linearise", "linearise": "linearise", "Margins": "margins",
    "margins": "margins", "optimise": "optimise", "Proof": "proof", "prove": "proof", "assess": "tuning",
    "tune": "tuning",
}  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = importlib.import_module(f"{__name__}.{_HOME[name]}")
    if _HOME[name] == name:
        return module  # it is called by the function of its name
    value = globals()[name] = getattr(module, name)
    return value
