"""The reference paper's table beside ours, and what a wrong torque constant in the evaluation does to it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pmsm_ctrl.design import Design
from pmsm_ctrl.identify.staircase import SweepResult, evaluate_sweep, simulated_records
from pmsm_ctrl.result import Result, jsonable
from pmsm_ctrl.section import Notice

__all__ = ["PAPER_CASES", "PaperCase", "PaperRow", "PaperTable", "paper_table"]

# A torque constant that would explain the paper's two deviations at once; a hypothesis, the paper does not say.
K_T_HYPOTHESIS = 1.0


@dataclass(frozen=True)
class PaperCase:
    """Friction put into the simulation, and what the paper's evaluation returned (None: not simulated there).

    Attributes
    ----------
    name : str
    F_c, F_v, paper_F_c, paper_F_v : float
        N m and N m s/rad.
    """

    name: str
    F_c: float
    F_v: float
    paper_F_c: float | None = None
    paper_F_v: float | None = None


PAPER_CASES = (
    PaperCase("the paper's simulation", 0.0213, 0.000168, 0.02066, 0.0001625),
    PaperCase("the paper's test stand, simulated here", 0.03553, 0.0001991),
)


@dataclass(frozen=True)
class PaperRow:
    """One parameter of one case: injected, the paper's figure, ours, and ours with the wrong torque constant."""

    case: str
    symbol: str
    unit: str
    injected: float
    paper: float | None
    ours: float
    stderr: float
    wrong_K_t: float

    def deviation(self, value: float | None) -> float | None:
        """Return the deviation from the injected value in percent."""
        return None if value is None else 100.0 * (value / self.injected - 1.0)


@dataclass(frozen=True, eq=False)
class PaperTable(Result):
    """The paper's table reproduced.

    Attributes
    ----------
    rows : tuple of PaperRow
    sweeps : tuple of SweepResult
        The evaluation of each case.
    K_t, K_t_wrong : float
        Torque constants of the two evaluations, N m/A peak.
    """

    rows: tuple[PaperRow, ...]
    sweeps: tuple[SweepResult, ...]
    K_t: float
    K_t_wrong: float

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Notices of the sweeps behind the table."""
        return tuple(notice for result in self.sweeps for notice in result.notices)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON."""
        rows = [
            vars(r) | {"ours_percent": r.deviation(r.ours), "paper_percent": r.deviation(r.paper)} for r in self.rows
        ]
        return jsonable({"schema": "pmsm-ctrl/paper-table/1", **self.doubts(), "rows": rows})


def paper_table(design: Design, *, repeats: int = 3, seed: int = 0, K_t_wrong: float = K_T_HYPOTHESIS) -> PaperTable:
    """Repeat the paper's experiment with its two pairs of friction values.

    Parameters
    ----------
    design : Design
        The reference motor; its friction is replaced by each case's.
    repeats, seed : int
        Records per case and seed of their noise.
    K_t_wrong : float
        Torque constant that the second evaluation of the same records assumes, N m/A peak.

    Returns
    -------
    PaperTable

    Raises
    ------
    RequestError
        When `repeats` is below 1.
    """
    rows: list[PaperRow] = []
    results = []
    for case in PAPER_CASES:
        injected = design.replace_effects(()).with_effect("coulomb", {"F_c": case.F_c})
        injected = injected.with_effect("viscous", {"F_v": case.F_v})
        records = simulated_records(injected, repeats=repeats, seed=seed)
        ours = evaluate_sweep(injected, records)
        # only the evaluation is wrong: the records were made by a controller with the right constant
        wrong = evaluate_sweep(injected.replace(assumed={"K_t": K_t_wrong}), records)
        results.append(ours)
        for symbol, paper in (("F_c", case.paper_F_c), ("F_v", case.paper_F_v)):
            estimate, put_in = ours.estimates[symbol], getattr(case, symbol)
            value = wrong.estimates[symbol].value
            rows.append(
                PaperRow(case.name, symbol, estimate.unit, put_in, paper, estimate.value, estimate.stderr, value)
            )
    return PaperTable(tuple(rows), tuple(results), design.K_t, K_t_wrong)
