"""What the requests of a page do to its session: files are received, tasks are started, their results are kept."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from typing import Any

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import PmsmCtrlError, RequestError
from pmsm_ctrl.log import CHANNELS
from pmsm_ctrl.workbench import own, sheet, takeaway, tasks
from pmsm_ctrl.workbench.live import Live
from pmsm_ctrl.workbench.session import Session, Sessions, needed
from pmsm_ctrl.workbench.workers import Workers

__all__ = ["Desk"]

POLL = 0.05  # s between two looks at a task's progress
PATIENCE = 10.0  # s that a page waits for news at most
MOST_LOGS = 40
MOST_STEPS = 100  # each one is repeated from the one before, in calls within calls
LONGEST_COLUMN = 300  # characters of a mapping


class Desk:
    """The sessions and their workers.

    Parameters
    ----------
    sessions : Sessions
    workers : Workers
    code : bool
        Whether effects that are written in a page are run.
    live : Live, optional
        What is tracked while the server runs.
    """

    def __init__(self, sessions: Sessions, workers: Workers, *, code: bool = False, live: Live | None = None) -> None:
        self.sessions, self.live = sessions, live
        self.code = code
        self.workers = workers
        self._running: dict[str, asyncio.Task[None]] = {}
        self._wanted: dict[str, tuple[str, Callable[[], Awaitable[None]]]] = {}

    async def news(self, session: Session, since: int) -> None:
        """Wait until a session has changed, for some seconds while something is computed.

        Parameters
        ----------
        session : Session
        since : int
            The revision that the page has.
        """
        waited = 0.0
        while session.revision == since and session.job is not None and waited < PATIENCE:
            await asyncio.sleep(POLL)
            waited += POLL

    def delete(self, session: Session) -> None:
        """Delete a session with its files, and end its process, which knows the logs by their names.

        Parameters
        ----------
        session : Session

        Raises
        ------
        RequestError
            While something is computed for it.
        """
        if session.job is not None:
            raise RequestError("this session is computing something in another tab; stop it first")
        self.workers.release(session.id)
        self.sessions.delete(session.id)

    # -- the design -------------------------------------------------------------------------------------------

    async def set_design(self, session: Session, asked: Mapping[str, Any]) -> None:
        """Take a design: an example, a TOML text, or a filled form; the logs are read again with it.

        Parameters
        ----------
        session : Session
        asked : dict
            ``example``; or ``toml`` and ``name``; or ``machine``, ``name`` and ``answers``.
        """
        if "example" in asked:
            design, facts, doubts = Design.example(str(asked["example"])), None, None
            origin = "an example of the package"
        elif "toml" in asked:
            name = str(asked.get("name", "design.toml"))[:200]
            design, facts, doubts, origin = sheet.from_text(str(asked["toml"]), name), None, None, name
        else:
            name, machine, filled = (needed(asked, key) for key in ("name", "machine", "answers"))
            answers = {key: str(text)[:200] for key, text in _table(filled).items()}
            design, facts, doubts = sheet.from_form(str(name), str(machine), answers)
            origin = "the datasheet form"
            session.changed(form={"name": name, "machine": machine, "answers": answers})
        session.message = ""
        logs = [entry | {"info": None} for entry in session.state["logs"]]
        session.changed(design=sheet.shown(design, origin, facts, doubts), logs=logs, steps=[], model=None)
        self._read_all(session)

    # -- the logs ---------------------------------------------------------------------------------------------

    async def receive(self, session: Session, name: str, stream: AsyncIterator[bytes]) -> None:
        """Keep an uploaded file, and read it.

        Parameters
        ----------
        session : Session
        name : str
        stream : iterator of bytes

        Raises
        ------
        RequestError
            When there is no design yet, or there are too many logs.
        """
        if session.state["design"] is None:
            raise RequestError("choose a design first (step 1): it tells how the channels are read")
        if len(session.state["logs"]) >= MOST_LOGS:
            raise RequestError(f"a session takes {MOST_LOGS} logs; remove one first")
        identifier, path = session.new_log(name)
        part, size = path.with_name(f"{path.name}.part"), 0
        try:
            with open(part, "wb") as file:
                async for piece in stream:
                    file.write(piece)
                    size += len(piece)
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
        session.enter_log(identifier, path.name, name, size)
        self._read_all(session)

    def resume(self, session: Session) -> None:
        """Read what is not read yet: the logs of the command line, and those of a server that was ended meanwhile.

        Parameters
        ----------
        session : Session
        """
        state = session.state
        if session.job is None and state["design"] is not None and any(one["info"] is None for one in state["logs"]):
            self._read_all(session)

    def change_log(self, session: Session, identifier: str, asked: Mapping[str, Any]) -> None:
        """Change the role, the window or the mapping of a log.

        Parameters
        ----------
        session : Session
        identifier : str
        asked : dict
            ``role``, ``window`` (two times, s, or null) or ``mapping`` (channel to column).

        Raises
        ------
        RequestError
            For a value that is not accepted.
        """
        values: dict[str, Any] = {}
        if "role" in asked:
            if asked["role"] not in ("fit", "holdout", "off"):
                raise RequestError("the role of a log is fit, holdout or off")
            values["role"] = asked["role"]
        if "window" in asked:
            values["window"] = _window(asked["window"])
        if "mapping" in asked:
            mapping = {channel: str(column) for channel, column in _table(asked["mapping"]).items() if column}
            if not set(mapping) <= set(CHANNELS) or any(len(v) > LONGEST_COLUMN for v in mapping.values()):
                raise RequestError("a mapping names known channels and columns of the file")
            values |= {"mapping": mapping, "info": None}
        session.with_log(identifier, **values)
        session.changed(model=None, steps=[])
        self._read_all(session)

    def drop_log(self, session: Session, identifier: str) -> None:
        """Remove a log and its files.

        Parameters
        ----------
        session : Session
        identifier : str
        """
        entry = session.log(identifier)
        session.changed(logs=[one for one in session.state["logs"] if one is not entry], model=None, steps=[])
        session.forget(entry["file"])
        for path in session.folder.glob(f"{identifier}.curves-*"):
            session.forget(path.name)

    def _read_all(self, session: Session) -> None:
        """Read every log that is not read yet, one after the other."""

        async def work() -> None:
            while True:
                design = session.state["design"]
                entry = next((one for one in session.state["logs"] if one["info"] is None), None)
                if entry is None or design is None:
                    return
                session.job = {"kind": "read", "name": entry["name"], "share": None, "models": []}
                session.touched()
                try:
                    info = await self.workers.run(session.id, tasks.read, str(session.folder), entry, design["toml"])
                except PmsmCtrlError as error:
                    info = _unread(str(error))
                except Exception as error:  # the other logs are read none the less
                    info = _unread(f"{entry['name']}: {_unexpected(error)}")
                now = next((one for one in session.state["logs"] if one["id"] == entry["id"]), None)
                if now is not None and now["mapping"] == entry["mapping"] and session.state["design"] == design:
                    for path in session.folder.glob(f"{entry['id']}.curves-*"):
                        if path.name != info["curves"]:
                            session.forget(path.name)
                    session.with_log(entry["id"], info=info)
                elif now is None and info["curves"]:  # removed while it was read
                    session.forget(info["curves"])

        self._start(session, "read", work)

    # -- the model ---------------------------------------------------------------------------------------------

    def request(self, session: Session) -> dict[str, Any]:
        """Return what a task has to know of a session.

        Parameters
        ----------
        session : Session

        Returns
        -------
        dict

        Raises
        ------
        RequestError
            When design or logs are missing.
        """
        state = session.state
        if state["design"] is None:
            raise RequestError("choose a design first (step 1)")
        bad = next(
            (one["name"] for one in state["logs"] if one["role"] != "off" and (one["info"] or {}).get("error")), ""
        )
        if bad:
            raise RequestError(f"{bad} could not be read; correct its channels in step 2, or leave it out")
        asked = self._asked(session)
        if asked["code"] and not self.code:
            raise RequestError("this session has effects of its own; start the server with --allow-code")
        if not any(entry["role"] == "fit" for entry in asked["logs"]):
            raise RequestError("no log is marked 'fit'; mark at least one in step 2")
        return {"folder": str(session.folder), **asked, "steps": state["steps"]}

    def _asked(self, session: Session) -> dict[str, Any]:
        """Return the design and the logs that a model depends on."""
        logs = [
            {key: entry[key] for key in ("id", "file", "name", "mapping", "role", "window")}
            for entry in session.state["logs"]
            if entry["role"] != "off"
        ]
        return {"design": session.state["design"]["toml"], "logs": logs, "code": session.state.get("code", "")}

    def step(self, session: Session, asked: Mapping[str, Any]) -> None:
        """Change the model: begin, add, remove, undo, reorder, or let the diagnosis find all.

        Parameters
        ----------
        session : Session
        asked : dict
            ``{"begin": true}``, ``{"add": name}``, ``{"remove": name}``, ``{"undo": true}``, ``{"order": names}``
            or ``{"find": true}``.

        Raises
        ------
        RequestError
            For anything else, and while another step is being computed.
        """
        if session.job is not None:
            raise RequestError("another step is being computed; wait for it, or stop it")
        steps = list(session.state["steps"])
        if "add" in asked or "remove" in asked:
            kind = "add" if "add" in asked else "remove"
            steps.append({kind: str(asked[kind])[:80]})
        elif "undo" in asked:
            steps = steps[:-1]
        elif "order" in asked:
            steps = [{"add": str(name)[:80]} for name in _list(asked["order"])]
        elif "find" in asked:
            steps = [{"find": True}]
        elif "begin" not in asked:
            raise RequestError("a step is begin, add, remove, undo, order or find")
        if len(steps) > MOST_STEPS:
            raise RequestError(f"a session keeps {MOST_STEPS} steps; undo some, or begin again")
        request = self.request(session) | {"steps": steps}
        for name in (tasks.STOP, tasks.PROGRESS):
            session.forget(name)
        session.message = ""

        async def work() -> None:
            try:
                model = await self.workers.run(session.id, tasks.solve, request)
            finally:
                session.forget(tasks.STOP)  # else a process that repeats the search later would stop at once
            if self._asked(session) != {key: request[key] for key in ("design", "logs", "code")}:
                session.message = "the design or a log was changed meanwhile: compare again"
                return
            session.changed(model=model, steps=steps)
            self._sweep(session, model)

        self._start(session, "find" if "find" in asked else "step", work)

    async def set_code(self, session: Session, asked: Mapping[str, Any]) -> None:
        """Run effects that were written in the page, and offer them; the model begins anew.

        Parameters
        ----------
        session : Session
        asked : dict
            ``code``, in Python; empty to take the effects back.

        Raises
        ------
        RequestError
            When the server was not started with ``--allow-code``, or the code cannot be run.
        """
        if not self.code:
            raise RequestError("code from the page is not run; start the server with --allow-code")
        if session.job is not None or session.state["design"] is None:
            raise RequestError("choose a design first, and wait until nothing is being computed")
        code = str(needed(asked, "code"))
        request = {"folder": str(session.folder), "code": code}
        found = []
        if code.strip():
            session.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            found = await self.workers.run(session.id, own.described, session.state["design"]["toml"], request)
        session.changed(code=code if found else "", own=found, steps=[], model=None)

    def stop(self, session: Session) -> None:
        """End a search after the step that it is at.

        Parameters
        ----------
        session : Session
        """
        if session.job is not None and session.job["kind"] == "find":
            (session.folder / tasks.STOP).touch()
            session.job = session.job | {"stopping": True}
            session.touched()

    async def preview(self, session: Session, asked: Mapping[str, str]) -> str:
        """Return the name of the curve of a candidate.

        Parameters
        ----------
        session : Session
        asked : dict
            ``effect`` and ``balance``.

        Returns
        -------
        str

        Raises
        ------
        RequestError
            While a step is being computed.
        """
        model = session.state["model"]
        if model is None or session.job is not None:
            raise RequestError("the model is being fitted")
        record = next(one for one in model["records"] if not one["held_out"])
        name: str = await self.workers.run(
            session.id, tasks.preview, self.request(session), needed(asked, "effect"), asked.get("balance", "torque"),
            record["curves"],
        )  # fmt: skip
        return name

    async def take(self, session: Session, kind: str) -> tuple[str, str, str]:
        """Return a file to take away.

        Parameters
        ----------
        session : Session
        kind : str
            One of `takeaway.KINDS`.

        Returns
        -------
        (str, str, str)
            Its name, its media type and its text.

        Raises
        ------
        RequestError
            For another kind, or before there is a model.
        """
        if kind not in takeaway.KINDS:
            raise RequestError(f"unknown file '{kind[:40]}' (known: {', '.join(takeaway.KINDS)})")
        if session.state["model"] is None:
            raise RequestError("nothing to take away yet: compare the design with a log first (step 3)")
        if session.job is not None:
            raise RequestError("another step is being computed; wait for it")
        suffix, media = takeaway.KINDS[kind]
        job: dict[str, Any] = {"kind": "take", "share": None, "models": []}
        session.job = job
        session.touched()
        try:
            text: str = await self.workers.run(session.id, takeaway.made, kind, self.request(session))
        finally:
            if session.job is job:  # else a reading has begun meanwhile
                session.job = None
                session.touched()
        return f"{takeaway.stem(session.state['design']['name'])}{suffix}", media, text

    def _sweep(self, session: Session, model: Mapping[str, Any]) -> None:
        """Delete the curves of earlier models."""
        used = {record["curves"] for record in model["records"]}
        for path in session.folder.glob("model-*"):
            if not any(path.name.startswith(name) for name in used):
                session.forget(path.name)

    # -- jobs -------------------------------------------------------------------------------------------------

    def _start(self, session: Session, kind: str, work: Callable[[], Awaitable[None]]) -> None:
        """Run something for a session in the background; readings that are asked for meanwhile follow."""
        running = self._running.get(session.id)
        if running is not None and not running.done():
            self._wanted[session.id] = (kind, work)
            return
        session.job = {"kind": kind, "share": None, "models": []}
        session.touched()
        self._running[session.id] = asyncio.create_task(self._run(session, kind, work))

    async def _run(self, session: Session, kind: str, work: Callable[[], Awaitable[None]]) -> None:
        watcher = asyncio.create_task(_watch(session)) if kind == "find" else None
        try:
            await work()
        except PmsmCtrlError as error:
            session.message = str(error)
        except Exception as error:  # the page says so, and lives on
            session.message = _unexpected(error)
        finally:
            if watcher is not None:
                watcher.cancel()
                with contextlib.suppress(asyncio.CancelledError):
                    await watcher
            session.job = None
            session.touched()
            self._running.pop(session.id, None)
            waiting = self._wanted.pop(session.id, None)
            if waiting is not None:
                self._start(session, *waiting)


def _unread(error: str) -> dict[str, Any]:
    return {"columns": [], "error": error, "curves": ""}


def _unexpected(error: Exception) -> str:
    return f"unexpected {type(error).__name__}: {error}. Please report it"


def _list(given: Any) -> list[Any]:
    if not isinstance(given, list) or len(given) > MOST_LOGS:
        raise RequestError("a list of names was expected")
    return given


def _table(given: Any) -> dict[str, Any]:
    if not isinstance(given, dict):
        raise RequestError("names with their values were expected")
    return given


def _window(given: Any) -> list[float] | None:
    if given is None:
        return None
    try:
        start, stop = (float(one) for one in given)
    except (TypeError, ValueError):
        raise RequestError("a window is two times in seconds") from None
    if not (math.isfinite(start) and math.isfinite(stop) and start < stop):
        raise RequestError("a window begins before it ends, both at finite times")
    return [start, stop]


async def _watch(session: Session) -> None:
    """Show what a search has found so far."""
    path, seen = session.folder / tasks.PROGRESS, ""
    while True:
        await asyncio.sleep(2 * POLL)
        with contextlib.suppress(OSError, ValueError):
            text = path.read_text(encoding="utf-8")
            if text != seen and session.job is not None:
                seen, session.job = text, session.job | json.loads(text)
                session.touched()
