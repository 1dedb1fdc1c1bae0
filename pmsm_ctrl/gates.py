"""compare, diagnose and verify as gates of an automatic check: what is not accepted gives exit status 1."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pmsm_ctrl.console import NEGATIVE

if TYPE_CHECKING:
    from pmsm_ctrl.regression.record_result import RecordResult
    from pmsm_ctrl.result import Verdict

__all__ = [
    "ComparedOption", "FailOn", "FailOnOption", "FailOnOutcome", "MaxErrorLeftOption", "MaxErrorOption",
    "OutcomeOption", "require_accepted", "require_applied",
]  # fmt: skip


class FailOn(StrEnum):
    """A verdict that fails; `MISSING` is ``effects_missing``, and `ANY` every verdict but ``consistent``."""

    MISSING = "missing"
    UNEXPLAINED = "unexplained"
    IMPLAUSIBLE = "implausible"
    INCONCLUSIVE = "inconclusive"
    ANY = "any"

    def meets(self, verdict: Verdict) -> bool:
        """Whether a verdict is this one.

        Parameters
        ----------
        verdict : Verdict
        """
        if self is FailOn.ANY:
            return verdict.value != "consistent"
        return verdict.value == ("effects_missing" if self is FailOn.MISSING else self.value)


class FailOnOutcome(StrEnum):
    """A verdict of `verify` that fails; `ANY` is every one but ``applied``."""

    PARTLY_APPLIED = "partly_applied"
    NOT_APPLIED = "not_applied"
    WRONG_GAIN = "wrong_gain"
    WRONG_SIGN = "wrong_sign"
    LATE = "late"
    LIMIT_CYCLE = "limit_cycle"
    INCONCLUSIVE = "inconclusive"
    ANY = "any"


def _share(text: str) -> float:
    """Read ``3%`` or ``0.03``; a bare 3 would be 300 %, a limit that no model exceeds."""
    percent = text.strip().endswith("%")
    try:
        value = float(text.strip().rstrip("%"))
    except ValueError:
        value = -1.0
    if not 0.0 < value < float("inf"):
        raise typer.BadParameter(f"'{text}': a share of the measured torque was expected, such as 3% or 0.03")
    if not percent and value >= 1.0:
        raise typer.BadParameter(
            f"'{text}': a share below 1 was expected, such as 0.03, or percent with its sign: {text.strip()}%"
        )
    return 0.01 * value if percent else value


def _of_compare(asked: list[FailOn] | None) -> list[FailOn] | None:
    """Refuse what `compare` never answers: a check of it would never fail."""
    if asked and FailOn.MISSING in asked:
        raise typer.BadParameter(
            "'missing': compare names no effects, and would never fail; accepted: "
            f"{', '.join(one for one in FailOn if one is not FailOn.MISSING)}; diagnose takes missing"
        )
    return asked


FailOnOption = Annotated[
    list[FailOn] | None,
    typer.Option("--fail-on", metavar="VERDICT", help=f"exit status 1 for {', '.join(FailOn)}; may be repeated"),
]
ComparedOption = Annotated[
    list[FailOn] | None,
    typer.Option(
        "--fail-on",
        metavar="VERDICT",
        callback=_of_compare,
        help="exit status 1 for unexplained, implausible, inconclusive, any; may be repeated",
    ),
]
OutcomeOption = Annotated[
    list[FailOnOutcome] | None,
    typer.Option("--fail-on", metavar="VERDICT", help=f"exit status 1 for {', '.join(FailOnOutcome)}; may be repeated"),
]
ABOVE = "exit status 1 above this error of the torque, such as 3%"
MaxErrorOption = Annotated[Any, typer.Option("--max-error", metavar="SHARE", parser=_share, help=ABOVE)]
MaxErrorLeftOption = Annotated[
    Any, typer.Option("--max-error", metavar="SHARE", parser=_share, help=f"{ABOVE}, left with the effects found")
]


def require_accepted(
    verdict: Verdict, records: Iterable[RecordResult], fail_on: Iterable[FailOn] | None, max_error: float | None
) -> None:
    """Leave with exit status 1 where a result is not accepted, with one line on stderr for each reason.

    Parameters
    ----------
    verdict : Verdict
    records : iterable of RecordResult
        With the errors that the model leaves, `after` where it was fitted; held-out ones count as well.
    fail_on : iterable of FailOn, optional
    max_error : float, optional
        Largest relative error of the torque.

    Raises
    ------
    typer.Exit
        When the verdict is one of those, or the error of a record is larger.
    """
    failed = [f"the verdict is {verdict.value} (--fail-on {one})" for one in fail_on or () if one.meets(verdict)]
    for record in records if max_error is not None else ():
        error = (record.after or record.before)["torque"]["relative"]
        if max_error is not None and not error <= max_error:
            which = "held-out record" if record.held_out else "record"
            failed.append(
                f"error of {100.0 * error:.3g} % on the {which} {record.name}, --max-error {100.0 * max_error:.3g} %"
            )
    _leave(failed)


def require_applied(verdict: str, fail_on: Iterable[FailOnOutcome] | None) -> None:
    """Leave with exit status 1 where a verdict of `verify` is one of those.

    Parameters
    ----------
    verdict : str
    fail_on : iterable of FailOnOutcome, optional

    Raises
    ------
    typer.Exit
        When it is.
    """
    met = (one for one in fail_on or () if one.value == verdict or (one is FailOnOutcome.ANY and verdict != "applied"))
    _leave([f"the verdict is {verdict} (--fail-on {one})" for one in met])


def _leave(failed: list[str]) -> None:
    for line in failed:
        print(f"pmsm-ctrl: failed: {line}", file=sys.stderr)
    if failed:
        raise typer.Exit(NEGATIVE)
