"""export: a design's loop gains, compensator, filters of the current and friction tracker as source code."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import RequestError, UnsafeGainError, require_kind
from pmsm_ctrl.export.blocks import Block, identifier
from pmsm_ctrl.export.compensator import compensator, exported_gain
from pmsm_ctrl.export.files import br_library, c_header, c_source, st_block, tcpou
from pmsm_ctrl.export.filters import filters, has_filters
from pmsm_ctrl.log import Log

if TYPE_CHECKING:
    from pmsm_ctrl.track.settings import Settings

__all__ = ["export", "export_files"]

LANGUAGES = ("c", "st")
FLAVOURS = ("iec", "br", "beckhoff")
PARTS = ("compensation", "filter", "tracker")
PRECISIONS = ("double", "single")


def export(
    design: Design, language: str, *, part: str = "compensation", flavour: str = "iec",
    settings: Settings | None = None, force: bool = False, precision: str = "double",
) -> str:  # fmt: skip
    """Return the design's gains and compensator, or its friction tracker, as one source text.

    The compensator returns the current to add to the speed controller's output, as in the simulation: gain times the
    torque of the compensated effects over K_t, with the sign of the speed smoothed over the design's width. Where the
    design's compensation is adaptive, F_c and F_v are inputs for the tracker's outputs. The tracker is the extended
    Kalman filter of `pmsm_ctrl.track`, with a fixed number of operations.

    Parameters
    ----------
    design : Design
        Its ``[compensation]`` says what is compensated; without a gain, 1 is exported.
    language : {"c", "st"}
        C99 with math.h alone, or a Structured Text function block.
    part : {"compensation", "filter", "tracker"}
        What to export; the filters are those of the current reference.
    flavour : {"iec", "br", "beckhoff"}
        For Structured Text: the standard, Automation Studio, TwinCAT 3. B&R needs several files: see `export_files`.
    settings : pmsm_ctrl.track.Settings, optional
        Settings of the tracker.
    force : bool
        Export a compensation whatever its gain, which is then not judged; the text says so.
    precision : {"double", "single"}
        Of all numbers in the program: double and LREAL, or float and REAL.

    Returns
    -------
    str
        The source text.

    Raises
    ------
    RequestError
        For another language, part, flavour or precision, an effect that a drive cannot evaluate, or a gain that is not
        safe (`UnsafeGainError`).
    """
    require_kind(design, Design, "design")
    _check(language, flavour, part, precision)
    if flavour == "br":
        raise RequestError("flavour: found 'br', which is several files; name a folder, or take iec or beckhoff")
    block = replace(_block(design, part, settings, force), single=precision == "single")
    if language == "c":
        return c_source(block, with_header=True)
    return tcpou(block) if flavour == "beckhoff" else st_block(block)


def export_files(
    design: Design, language: str, *, flavour: str = "iec", settings: Settings | None = None, force: bool = False,
    precision: str = "double", logs: Sequence[Log] = (),
) -> dict[str, str]:  # fmt: skip
    """Return every file of the export: compensator, filters, tracker, and the tables that drives accept.

    Parameters
    ----------
    design : Design
        As for `export`.
    language : {"c", "st"}
    flavour : {"iec", "br", "beckhoff"}
    settings : pmsm_ctrl.track.Settings, optional
        Settings of the tracker. Without them, a design that a tracker cannot work with gets a file with the reason
        in its place.
    force : bool
        Export a compensation whatever its gain, which is then not judged; the text says so.
    precision : {"double", "single"}
        Of all numbers in the program: double and LREAL, or float and REAL.
    logs : sequence of Log
        Of this axis, for what the tables take from a log: the errors of simulators' joints, and the backlash.

    Returns
    -------
    dict of str to str
        File names to texts.

    Raises
    ------
    RequestError
        For another language, flavour or precision, an effect that a drive cannot evaluate, a gain that is not safe, or
        settings for a tracker that cannot work.
    LogError
        When a log cannot be evaluated.
    """
    from pmsm_ctrl.export.tables import table_files

    require_kind(design, Design, "design")
    _check(language, flavour, "compensation", precision)
    blocks = [_block(design, "compensation", settings, force)]
    blocks += [filters(design)] if has_filters(design) else []
    missing = ""
    try:
        blocks.append(_block(design, "tracker", settings, force))
    except RequestError as error:
        if settings is not None:
            raise
        missing = str(error)
    blocks = [replace(block, single=precision == "single") for block in blocks]
    if language == "c":
        files = {f"{b.name}.h": c_header(b) for b in blocks} | {f"{b.name}.c": c_source(b) for b in blocks}
    elif flavour == "br":
        files = br_library(identifier(design.name), blocks)
    elif flavour == "beckhoff":
        files = {f"FB_{b.name}.TcPOU": tcpou(b) for b in blocks}
    else:
        files = {f"FB_{b.name}.st": st_block(b) for b in blocks}
    if missing:
        files[f"{blocks[0].axis}_tracker_not_exported.txt"] = f"{missing}\n"
    return files | table_files(design, logs)


def _block(design: Design, part: str, settings: Settings | None, force: bool) -> Block:
    if part == "compensation":
        block = compensator(design)
        if force:
            return replace(block, title=f"{block.title}; its gain is not known to be safe (--force)")
        why = _require_safe(design)
        return replace(block, title=f"{block.title}; the safety of its gain is not known: {why}") if why else block
    if part == "filter":
        return filters(design)
    from pmsm_ctrl.export.tracker import tracker

    return tracker(design, settings)


def _require_safe(design: Design) -> str:
    """Refuse a gain beyond its safe window; return why a design cannot be simulated, and its gain not be judged."""
    from pmsm_ctrl.compensate.safety import gain_verdict

    gain = exported_gain(design)
    verdict = gain_verdict(design, gain)
    source = design.compensation.source
    by = source if source == "observer" else f"{source} speed"
    if verdict.safe is False:
        raise UnsafeGainError(
            f"{design.source or design.name}: compensation.gain: {100.0 * gain:g} % with the "
            f"{by} is not safe: {verdict.why}. `pmsm-ctrl compensate` recommends a source and a safe gain, where one "
            "lowers the error, and prints the command that exports them; --force exports this one"
        )
    return verdict.why


def _check(language: str, flavour: str, part: str, precision: str) -> None:
    chosen = (
        ("language", language, LANGUAGES), ("flavour", flavour, FLAVOURS), ("part", part, PARTS),
        ("precision", precision, PRECISIONS),
    )  # fmt: skip
    for label, found, accepted in chosen:
        if found not in accepted:
            raise RequestError(f"{label}: found '{found}'; accepted: {', '.join(accepted)}")
    if language == "c" and flavour != "iec":
        raise RequestError(f"flavour: found '{flavour}' for C; flavours are Structured Text's ({', '.join(FLAVOURS)})")
