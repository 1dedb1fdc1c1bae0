"""The pages and the requests of the workbench, as an ASGI application; what they mean is in `desk`."""

from __future__ import annotations

import contextlib
import json
import re
import traceback
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, RedirectResponse, Response
from starlette.routing import Route

from pmsm_ctrl.errors import PmsmCtrlError, RequestError
from pmsm_ctrl.files import example_designs
from pmsm_ctrl.workbench import own, sheet, views
from pmsm_ctrl.workbench.desk import Desk
from pmsm_ctrl.workbench.session import Session

__all__ = ["make_app"]

PAGES = Path(__file__).with_name("pages")
OWN = (
    "workbench.css", "workbench.js", "dom.js", "design.js", "logs.js", "plots.js", "compare.js", "takeaway.js",
    "live.js",
)  # fmt: skip
BOKEH = ("bokeh.min.js", "bokeh-api.min.js")
_REVISION = re.compile(r"[0-9]{1,12}")
MOST_JSON = 1 << 20  # bytes of a request that is no upload
Handler = Callable[[Request], Awaitable[Response]]


def make_app(desk: Desk) -> Starlette:
    """Return the application of a desk.

    Parameters
    ----------
    desk : Desk

    Returns
    -------
    Starlette
    """

    @contextlib.asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        desk.workers.prepare()
        if desk.live is not None:
            desk.live.start()
        yield
        desk.workers.close()

    answers, s = _Answers(desk), "/s/{session}"
    routes: list[tuple[str, Handler, list[str]]] = [
        ("/", answers.start, ["GET"]),
        (f"{s}/", answers.page, ["GET"]),
        ("/static/{name}", answers.static, ["GET"]),
        (f"{s}/", answers.delete, ["DELETE"]),
        (f"{s}/state", answers.state, ["GET"]),
        (f"{s}/about", answers.about, ["GET"]),
        (f"{s}/design", answers.design, ["POST"]),
        (f"{s}/logs", answers.upload, ["PUT"]),
        (f"{s}/logs/{{log}}", answers.change_log, ["POST", "DELETE"]),
        (f"{s}/steps", answers.step, ["POST"]),
        (f"{s}/effects", answers.effects, ["POST"]),
        (f"{s}/stop", answers.stop, ["POST"]),
        (f"{s}/live", answers.live, ["GET"]),
        (f"{s}/view/{{what}}", answers.view, ["GET"]),
        (f"{s}/take/{{kind}}", answers.take, ["GET"]),
    ]
    return Starlette(
        routes=[Route(path, _refusing(handler), methods=methods) for path, handler, methods in routes],
        lifespan=lifespan,
    )


class _Answers:
    """One method for every kind of request."""

    def __init__(self, desk: Desk) -> None:
        self.desk = desk

    def session(self, request: Request) -> Session:
        return self.desk.sessions.get(request.path_params["session"])

    def shown(self, request: Request) -> Response:
        return JSONResponse(self.session(request).shown())

    async def start(self, request: Request) -> Response:
        return RedirectResponse(f"s/{self.desk.sessions.new().id}/", 303)

    async def page(self, request: Request) -> Response:
        self.session(request)
        return FileResponse(PAGES / "workbench.html", media_type="text/html; charset=utf-8")

    async def delete(self, request: Request) -> Response:
        self.desk.delete(self.session(request))
        return JSONResponse({"sessions": await run_in_threadpool(self.desk.sessions.kept)})

    async def static(self, request: Request) -> Response:
        name = request.path_params["name"]
        path = PAGES / name if name in OWN else _bokeh() / name if name in BOKEH else None
        if path is None:
            return JSONResponse({"error": "no such file"}, 404)
        kept = "private, max-age=86400" if name in BOKEH else "no-cache"
        return FileResponse(path, headers={"cache-control": kept})

    async def state(self, request: Request) -> Response:
        since, session = request.query_params.get("since", ""), self.session(request)
        self.desk.resume(session)
        if _REVISION.fullmatch(since):
            await self.desk.news(session, int(since))
        return self.shown(request)

    async def about(self, request: Request) -> Response:
        known: dict[str, Any] = {
            "form": sheet.form(),
            "examples": list(example_designs()),
            "channels": views.channels(),
            "live": self.desk.live is not None,
        }
        known["template"] = own.TEMPLATE if self.desk.code else ""
        return JSONResponse(known | {"sessions": await run_in_threadpool(self.desk.sessions.kept)})

    async def design(self, request: Request) -> Response:
        await self.desk.set_design(self.session(request), await _json(request))
        return self.shown(request)

    async def upload(self, request: Request) -> Response:
        name = request.query_params.get("name", "log")[:200]
        await self.desk.receive(self.session(request), name, request.stream())
        return self.shown(request)

    async def change_log(self, request: Request) -> Response:
        session, identifier = self.session(request), request.path_params["log"]
        if request.method == "DELETE":
            self.desk.drop_log(session, identifier)
        else:
            self.desk.change_log(session, identifier, await _json(request))
        return self.shown(request)

    async def step(self, request: Request) -> Response:
        self.desk.step(self.session(request), await _json(request))
        return self.shown(request)

    async def effects(self, request: Request) -> Response:
        await self.desk.set_code(self.session(request), await _json(request))
        return self.shown(request)

    async def stop(self, request: Request) -> Response:
        self.desk.stop(self.session(request))
        return self.shown(request)

    async def live(self, request: Request) -> Response:
        if self.desk.live is None:
            return JSONResponse({"error": "nothing is tracked; start the server with --live SOURCE"}, 404)
        return JSONResponse(self.desk.live.shown())

    async def view(self, request: Request) -> Response:
        what, session, asked = request.path_params["what"], self.session(request), dict(request.query_params)
        if what not in views.VIEWS:
            return JSONResponse({"error": "no such view"}, 404)
        if what == "preview":
            asked["curves"] = await self.desk.preview(session, asked)
        body = await run_in_threadpool(views.VIEWS[what], session, asked)
        return Response(body, media_type="application/octet-stream")

    async def take(self, request: Request) -> Response:
        name, kind, text = await self.desk.take(self.session(request), request.path_params["kind"])
        headers = {"content-disposition": f'attachment; filename="{name}"'}
        return Response(text, media_type=kind, headers=headers)


def _refusing(handler: Handler) -> Handler:
    """Answer an error that is raised on purpose with its message, and one at a field with the field."""

    async def careful(request: Request) -> Response:
        try:
            return await handler(request)
        except sheet.FormError as error:
            return JSONResponse({"error": str(error), "fields": error.fields}, 422)
        except PmsmCtrlError as error:
            return JSONResponse({"error": str(error)}, 400)
        except ClientDisconnect:
            return JSONResponse({"error": "the upload ended early, or is larger than --max-upload"}, 413)
        except OSError as error:
            return JSONResponse({"error": f"a file of this session: {error.strerror or error}"}, 500)
        except Exception as error:  # a defect: said in the page, and told in full where the server was started
            traceback.print_exc()
            return JSONResponse({"error": f"unexpected {type(error).__name__}: {error}. Please report it"}, 500)

    return careful


async def _json(request: Request) -> Mapping[str, Any]:
    body = b""
    async for piece in request.stream():
        body += piece
        if len(body) > MOST_JSON:
            raise RequestError("larger than 1 MB; a design in TOML or a few words were expected")
    try:
        found = json.loads(body)
    except (ValueError, RecursionError):
        raise RequestError("JSON was expected") from None
    if not isinstance(found, dict):
        raise RequestError("a JSON object was expected")
    return found


def _bokeh() -> Path:
    """Return the folder of Bokeh's scripts; the package itself is not imported."""
    spec = find_spec("bokeh")
    if spec is None or spec.origin is None:
        raise RequestError("Bokeh is not installed: pip install 'pmsm-ctrl[workbench]'")
    return Path(spec.origin).parent / "server" / "static" / "js"
