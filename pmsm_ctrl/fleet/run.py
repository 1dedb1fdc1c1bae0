"""fleet: all logs of a manifest to one table of results."""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import Effect, catalogue_with
from pmsm_ctrl.errors import RequestError, nearest
from pmsm_ctrl.files import sha256
from pmsm_ctrl.fleet import notices as words
from pmsm_ctrl.fleet.engine import Engine, completed
from pmsm_ctrl.fleet.evaluate import DONE, SET_ASIDE, Job, own_effects
from pmsm_ctrl.fleet.keys import Hashes, key_of
from pmsm_ctrl.fleet.manifest import Item, Manifest, items_of, read_manifest
from pmsm_ctrl.fleet.remote import changed
from pmsm_ctrl.fleet.result import FleetResult, Lost
from pmsm_ctrl.fleet.store import Row, Store
from pmsm_ctrl.regression.prediction import STATED
from pmsm_ctrl.section import Notice

__all__ = ["fleet"]


def fleet(
    manifest: Manifest | str | os.PathLike[str],
    *,
    engine: Engine | None = None,
    quiet: float = 0.0,
    retry: bool = False,
    progress: Callable[[float], None] | None = None,
) -> FleetResult:
    """Evaluate the logs of many axes: import, identify, compare and diagnose each, into one table of results.

    What was evaluated before, by the same package with the same settings and design, is not evaluated again. A log that
    cannot be evaluated becomes a row with its reason.

    Parameters
    ----------
    manifest : Manifest or path
        Or the TOML file of one.
    engine : Engine, optional
        Workers; as many as the machine has cores if left out.
    quiet : float
        s; a log that was changed more recently may be incomplete, and is left for the next run.
    retry : bool
        Whether logs that were set aside are tried again.
    progress : function, optional
        Called with the share done, 0 to 1.

    Returns
    -------
    FleetResult

    Raises
    ------
    RequestError
        When the manifest is wrong or limits what is no parameter, a file of own effects cannot be run, or something is
        not installed.
    DesignError
        When a design is wrong.
    """
    started = time.perf_counter()
    given = manifest if isinstance(manifest, Manifest) else read_manifest(manifest)
    items = [item for item in items_of(given) if not quiet or _settled(item, quiet)]
    designs = {path: Design.read(path) for path in sorted({item.design for item in items} - {""})}
    digest, own = _loaded(given.effects)
    _require_parameters(given.limits, designs.values(), own)
    store = Store(given.results)
    hashes = Hashes(store.noted("hashes"))
    keys = {key_of(item, given.settings, hashes, digest): item for item in items}
    store.note("hashes", hashes.known)
    store.note("limits", given.limits)
    store.note("designs", {item.axis: item.design for item in items if item.design})
    done = store.done()
    if retry:
        again = {key for key, word in done.items() if word == SET_ASIDE and key in keys}
        store.forget(again)
        done = {key: word for key, word in done.items() if key not in again}
    jobs = [
        Job(item, key, designs.get(item.design), given.settings, given.effects, digest)
        for key, item in keys.items() if key not in done
    ]  # fmt: skip
    advance, finished, spent = progress or (lambda share: None), 0, 0.0
    for ready in completed(jobs, engine or Engine()) if jobs else ():
        rows = [row for of_one in ready for row in of_one]
        store.add(rows)
        finished += len(ready)
        spent += sum(row.value or 0.0 for row in rows if row.name == "processor_time")
        advance(finished / len(jobs))
    if jobs:
        store.join()
    return _result(given.results, keys, store, len(jobs), time.perf_counter() - started, spent)


def _loaded(effects: str) -> tuple[str, tuple[Effect, ...]]:
    """Return the hash and the effects of a file, which is run here first: what it lacks is said before the work."""
    if not effects:
        return "", ()
    try:
        digest = sha256(effects)
    except OSError as error:
        raise RequestError(f"{effects}: no own effects can be read here ({error.strerror})") from None
    return digest, own_effects(effects, digest)


def _require_parameters(limits: Mapping[str, float], designs: Iterable[Design], own: tuple[Effect, ...]) -> None:
    """Refuse a limit of what is no parameter: no trend would ever reach it. Of an effect that is found: `id.symbol`."""
    effects = catalogue_with(own)
    used = [effects[entry.id] for design in designs for entry in design.effects if entry.id in effects]
    symbols = {one.symbol: None for effect in (*used, *effects.values()) for one in effect.parameters}
    for name in limits:
        effect, _, symbol = name.rpartition(".")
        known = (
            {p.symbol: None for p in effects[found].parameters} if (found := effect.split(" ")[0]) in effects else {}
        )
        if symbol.split("#")[0] not in (known if effect else {*STATED, *symbols}):
            shown = [*STATED, *dict.fromkeys(p.symbol for one in used for p in one.parameters)]
            raise RequestError(
                f"[limits] {name}: no parameter has this name{nearest(name, [*shown, *symbols])} (known: "
                f"{', '.join(shown)}, those of the effects of the catalogue, and of one that is found, such as "
                "'cogging 24.a_c')"
            )


def _settled(item: Item, quiet: float) -> bool:
    """Whether none of its files was changed within the last seconds."""
    try:
        return all(time.time() - changed(file).timestamp() >= quiet for file in item.files)
    except OSError:  # it is gone, which the evaluation says
        return True


def _result(
    folder: str, keys: dict[str, Item], store: Store, evaluated: int, seconds: float, spent: float
) -> FleetResult:
    """Return what all logs of the manifest gave, those of earlier runs included."""
    rows = [row for row in store.read(("status", "verdict")) if row.key in keys]
    verdicts = Counter(row.name for row in rows if row.kind == "verdict" and row.source == "diagnose")
    lost = tuple(_lost(row) for row in rows if row.kind == "status" and row.name != DONE)
    return FleetResult(
        results=str(folder), axes=len({item.axis for item in keys.values()}),
        logs=sum(len(item.files) for item in keys.values()), evaluated=evaluated, reused=len(keys) - evaluated,
        verdicts=dict(sorted(verdicts.items())), lost=lost, seconds=seconds, processor_seconds=spent,
        notices=_notices(lost, len(keys)),
    )  # fmt: skip


def _lost(row: Row) -> Lost:
    return Lost(row.record, row.axis, row.text, row.name == SET_ASIDE)


def _notices(lost: tuple[Lost, ...], logs: int) -> tuple[Notice, ...]:
    aside = [one.record for one in lost if one.set_aside]
    failed = [one for one in lost if not one.set_aside]
    out = []
    if aside:
        out.append(words.SET_ASIDE(count=len(aside), names=", ".join(aside[:5])))
    if failed:
        out.append(words.FAILED(count=len(failed), logs=logs, reason=failed[0].reason))
    return tuple(out)
