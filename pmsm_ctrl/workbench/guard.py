"""What keeps other pages, other machines and other users out: an ASGI layer around everything the server answers."""

from __future__ import annotations

import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from ipaddress import ip_address
from typing import Any

__all__ = ["POLICY", "Guard"]

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

# No inline script and no evaluation. Bokeh puts style sheets into its own shadow trees, which needs inline styles.
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "content-security-policy": POLICY,
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",  # the address holds the token
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "x-frame-options": "DENY",
    "cache-control": "no-store",
}
SAFE = ("GET", "HEAD")
# How a browser says that somebody goes to a page: from a link, a bookmark, or the file that opens the workbench.
VISIT = {"sec-fetch-mode": "navigate", "sec-fetch-dest": "document"}


class Guard:
    """Answers only requests that name this server, come from its own pages and know the token.

    A page of another site cannot read the token, and cannot reach the server under another name (DNS rebinding). The
    number that a connection has reached is no such name.

    Parameters
    ----------
    app : ASGI application
        Sees the path without the token.
    token : str
        The first part of every path.
    hosts : frozenset of str
        What ``Host`` may say, with the port.
    limit : int
        Bytes that a request may bring.
    """

    def __init__(self, app: App, token: str, hosts: frozenset[str], limit: int) -> None:
        self.app = app
        self.token = token
        self.hosts = hosts
        self.limit = limit

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        if scope["type"] != "http":
            return
        refusal = self._refusal(scope)
        if refusal is not None:
            await _answer(send, *refusal)
            return
        rest = scope["path"][1 + len(self.token) :]
        if not rest:  # the addresses in the pages are relative
            await _answer(send, 308, "see the address that ends in a slash", f"/{self.token}/")
            return
        inner = dict(scope, path=rest, raw_path=rest.encode())
        inner["root_path"] = ""
        await self.app(inner, self._bounded(receive), _with_headers(send))

    def _refusal(self, scope: Scope) -> tuple[int, str] | None:
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        host = headers.get("host", "").lower()
        if host not in self.hosts and host != _reached(scope):
            return 421, "this server does not answer under that name"
        origin = headers.get("origin")
        if origin is not None and origin.lower() not in {f"http://{one}" for one in (*self.hosts, host)}:
            return 403, "a page of another origin may not use this server"
        visit = scope["method"] == "GET" and all(headers.get(name) == value for name, value in VISIT.items())
        if headers.get("sec-fetch-site", "same-origin") not in ("same-origin", "none") and not visit:
            return 403, "a page of another site may not use this server"
        given = scope["path"].split("/")[1]
        if not secrets.compare_digest(given.encode(), self.token.encode()):
            return 404, "no such address; open the one that 'pmsm-ctrl workbench' has printed"
        length = headers.get("content-length", "0")
        if scope["method"] not in SAFE and (not length.isdigit() or int(length) > self.limit):
            return 413, f"larger than {self.limit >> 20} MB; --max-upload sets another bound"
        return None

    def _bounded(self, receive: Receive) -> Receive:
        """Count what comes, whatever was announced; beyond the limit the connection counts as closed."""
        read = 0

        async def bounded() -> Message:
            nonlocal read
            message = await receive()
            read += len(message.get("body", b""))
            return message if read <= self.limit else {"type": "http.disconnect"}

        return bounded


def _reached(scope: Scope) -> str | None:
    """Return the number and port of this machine at which a connection has arrived."""
    server = scope.get("server")
    if not server or server[1] is None:
        return None
    number = str(server[0])
    try:
        ip_address(number)
    except ValueError:
        return None
    return f"{f'[{number}]' if ':' in number else number}:{server[1]}"


def _with_headers(send: Send) -> Send:
    async def extended(message: Message) -> None:
        if message["type"] == "http.response.start":
            have = {name.lower() for name, _ in message["headers"]}
            more = [(k.encode(), v.encode()) for k, v in HEADERS.items() if k.encode() not in have]
            message = dict(message, headers=[*message["headers"], *more])
        await send(message)

    return extended


async def _answer(send: Send, status: int, text: str, location: str = "") -> None:
    body = f"pmsm-ctrl workbench: {text}\n".encode()
    headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"content-length", str(len(body)).encode())]
    if location:
        headers.append((b"location", location.encode()))
    sending = _with_headers(send)
    await sending({"type": "http.response.start", "status": status, "headers": headers})
    await sending({"type": "http.response.body", "body": body})
