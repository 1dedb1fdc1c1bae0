"""The server of the workbench: an address of this machine alone, a random token in it, and the browser opened."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import secrets
import shutil
import socket
import sys
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.workbench import sheet
from pmsm_ctrl.workbench.app import make_app
from pmsm_ctrl.workbench.desk import Desk
from pmsm_ctrl.workbench.guard import Guard
from pmsm_ctrl.workbench.live import Live
from pmsm_ctrl.workbench.session import Session, Sessions, default_folder
from pmsm_ctrl.workbench.workers import Workers

__all__ = ["Settings", "begun", "guarded", "listening", "opened_by", "serve"]

LOCAL = "127.0.0.1"
PORT = 8720  # tried first, so that a bookmark's history is not full of ports; any free one if it is taken
GRACE = 2  # s for open connections when the server ends


@dataclass(frozen=True)
class Settings:
    """How the server listens.

    Attributes
    ----------
    host : str
        Address to listen on; another one than the default can be reached from other machines.
    port : int
        0 for a usual one, or any that is free.
    browser : bool
        Whether the browser is opened.
    upload : int
        Bytes that a file may have.
    folder : Path
        Where sessions are kept.
    token : str
        Random; part of every address.
    code : bool
        Whether effects that are written in the page are run: whoever has the address can run anything then.
    """

    host: str = LOCAL
    port: int = 0
    browser: bool = True
    upload: int = 2048 << 20
    folder: Path = field(default_factory=default_folder)
    token: str = field(default_factory=lambda: secrets.token_urlsafe(18), repr=False)
    code: bool = False


def guarded(desk: Desk, settings: Settings, port: int) -> Guard:
    """Return the application behind its guard.

    Parameters
    ----------
    desk : Desk
    settings : Settings
    port : int
        That the server listens on.

    Returns
    -------
    Guard
    """
    names = (
        {LOCAL, "localhost", "[::1]"} if settings.host in (LOCAL, "localhost", "::1") else set(_names(settings.host))
    )
    return Guard(make_app(desk), settings.token, frozenset(f"{name}:{port}".lower() for name in names), settings.upload)


def _names(host: str) -> list[str]:
    """Return by which names a server that listens elsewhere is called."""
    if host not in ("0.0.0.0", "::"):
        return [f"[{host}]" if ":" in host else host, LOCAL, "localhost"]
    own = {socket.gethostname(), LOCAL, "localhost"}
    with contextlib.suppress(OSError):
        own |= {str(found[4][0]) for found in socket.getaddrinfo(socket.gethostname(), None)}
    return [f"[{name}]" if ":" in name else name for name in own]


def begun(desk: Desk, design: Path | None, logs: Sequence[Path]) -> Session:
    """Return a session with the design and copies of the logs that the command line names.

    Parameters
    ----------
    desk : Desk
    design : Path or None
    logs : sequence of Path

    Returns
    -------
    Session

    Raises
    ------
    RequestError
        When logs are given without a design, or a log does not exist.
    """
    from pmsm_ctrl.design import Design

    session = desk.sessions.new()
    if design is None:
        if logs:
            raise RequestError("workbench: logs need a design that tells how they are read; name it first")
        return session
    session.changed(design=sheet.shown(Design.read(design).model_copy(update={"source": ""}), design.name))
    for path in logs:
        identifier, copy = session.new_log(path.name)
        try:
            shutil.copyfile(path, copy)
        except OSError as error:
            raise RequestError(f"{path}: {error.strerror}; a log was expected") from None
        session.enter_log(identifier, copy.name, path.name, copy.stat().st_size)
    return session


def serve(settings: Settings, design: Path | None = None, logs: Sequence[Path] = (), live: Live | None = None) -> None:
    """Serve the workbench until it is interrupted.

    Parameters
    ----------
    settings : Settings
    design : Path, optional
        With which a session begins.
    logs : sequence of Path
        They are copied into the session.
    live : Live, optional
        What is tracked while the server runs.

    Raises
    ------
    RequestError
        When the address cannot be listened on, or a package is missing.
    """
    import webbrowser

    import uvicorn

    desk = Desk(Sessions(settings.folder), Workers(), code=settings.code, live=live)
    try:
        settings.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError as error:
        raise RequestError(f"{settings.folder}: cannot be made ({error.strerror})") from None
    session = begun(desk, design, logs) if design is not None or logs else None
    socket_used = listening(settings.host, settings.port)
    port = int(socket_used.getsockname()[1])
    shown = LOCAL if settings.host in ("0.0.0.0", "::") else settings.host
    address = f"http://{f'[{shown}]' if ':' in shown else shown}:{port}/{settings.token}/"
    if session is not None:
        address += f"s/{session.id}/"
    if settings.host not in (LOCAL, "localhost", "::1"):
        print(
            f"pmsm-ctrl: warning: listening on {settings.host}: whoever has this address can read and change the "
            "sessions, unencrypted. Use a trusted network, or a tunnel (ssh -L) instead",
            file=sys.stderr,
        )
    if settings.code:
        print("pmsm-ctrl: warning: whoever has this address can run Python code as this user", file=sys.stderr)
    print(f"workbench: {address}\nsessions: {settings.folder}\nCtrl-C ends the server; sessions are kept", flush=True)
    app: Any = guarded(desk, settings, port)
    server = uvicorn.Server(uvicorn.Config(
        app, log_level="warning", access_log=False, server_header=False, timeout_graceful_shutdown=GRACE,
        proxy_headers=False,
    ))  # fmt: skip
    door = opened_by(settings.folder, address) if settings.browser else None
    if door is not None:
        # a browser in the terminal returns when it is left, and the server has to answer before
        threading.Thread(target=webbrowser.open, args=(door.as_uri(),), daemon=True).start()
    try:
        with contextlib.suppress(KeyboardInterrupt):
            server.run(sockets=[socket_used])
    finally:
        if door is not None:
            door.unlink(missing_ok=True)
        for process in multiprocessing.active_children():  # a search would be finished before the server ends
            process.terminate()
        # the threads that watch them end with them; at the end of the interpreter they would race with its own clearing
        for thread in threading.enumerate():
            if thread is not threading.current_thread() and not thread.daemon:
                thread.join(1.0)


def opened_by(folder: Path, address: str) -> Path:
    """Write a page that leads to an address, readable for this user alone.

    The browser is started with its name: every user of a computer sees the words that a program was started with, and
    the address holds the token.

    Parameters
    ----------
    folder : Path
    address : str

    Returns
    -------
    Path
    """
    path = folder / f"open-{secrets.token_hex(4)}.html"
    text = (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>workbench</title>'
        f'<meta http-equiv="refresh" content="0; url={address}"></head>'
        f'<body><p><a href="{address}">Open the workbench</a></p></body></html>\n'
    )
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as file:
        file.write(text)
    return path.resolve()


def listening(host: str, port: int) -> socket.socket:
    """Return a socket that listens.

    Parameters
    ----------
    host : str
    port : int
        0 for the usual one, or any that is free.

    Returns
    -------
    socket

    Raises
    ------
    RequestError
        When that is not possible.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    for wanted in (port,) if port else (PORT, 0):
        # asyncio sends small answers at once only where the protocol is named; else they wait 40 ms for each other
        found = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
        if os.name == "posix":  # on Windows it would let another process listen on the same port
            found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            found.bind((host, wanted))
            found.listen(64)
            return found
        except OSError as error:
            found.close()
            reason = error.strerror or str(error)
    raise RequestError(f"--host {host} --port {port}: cannot listen there ({reason})")
