"""The command workbench: the local page, and what it is started with."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pmsm_ctrl.console import parse_map
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.options import EstimateOption, MapOption, estimated_names

if TYPE_CHECKING:
    from pmsm_ctrl.workbench.live import Live

__all__ = ["WORKBENCH_COMMANDS"]


def workbench(
    design: Annotated[
        Path | None, typer.Argument(metavar="DESIGN", help="design in TOML; or chosen in the page")
    ] = None,
    logs: Annotated[list[Path] | None, typer.Argument(metavar="LOG...", help="logs; or dropped onto the page")] = None,
    host: Annotated[
        str,
        typer.Option(
            "--host",
            metavar="ADDRESS",
            help="address to listen on: all who reach it can use the page, unencrypted",
        ),
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option("--port", metavar="N", min=0, max=65535, help="0: a free one")] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="open the page in the browser")] = True,
    max_upload: Annotated[
        int, typer.Option("--max-upload", metavar="MB", min=1, help="largest file that is accepted")
    ] = 2048,
    folder: Annotated[Path | None, typer.Option("--folder", metavar="FOLDER", help="where sessions are kept")] = None,
    allow_code: Annotated[
        bool, typer.Option("--allow-code", help="run effects that are written in the page: RUNS Python code from there")
    ] = False,
    live: Annotated[
        str | None,
        typer.Option(
            "--live", metavar="SOURCE", help="show F_c and F_v of a growing file, - for stdin, or ads://NETID"
        ),
    ] = None,
    mapping: MapOption = None,
    estimate: EstimateOption = None,
) -> None:
    """Open the workbench, a local page in the browser. It compares, ranks the missing effects and adds them."""
    from dataclasses import replace

    _require_packages()
    from pmsm_ctrl.importers import log_files
    from pmsm_ctrl.workbench import Settings, serve

    settings = Settings(host=host, port=port, browser=browser, upload=max_upload << 20, code=allow_code)
    if folder is not None:
        settings = replace(settings, folder=folder)
    serve(settings, design, log_files(logs or ()), _live(design, live, mapping, estimate))


def _require_packages() -> None:
    """Refuse to start without what the extra installs."""
    from importlib.util import find_spec

    missing = [name for name in ("starlette", "uvicorn", "bokeh") if find_spec(name) is None]
    if missing:
        raise RequestError(f"workbench: {', '.join(missing)} not installed: pip install 'pmsm-ctrl[workbench]'")


def _live(design: Path | None, source: str | None, mapping: list[str] | None, estimate: str | None) -> Live | None:
    """Return what is tracked while the page is open."""
    if source is None:
        if mapping or estimate:
            raise RequestError("--map and --estimate: they are of --live SOURCE, which is not given")
        return None
    if design is None:
        raise RequestError("workbench: --live needs DESIGN, whose friction it begins with")
    from pmsm_ctrl.design import Design
    from pmsm_ctrl.workbench.live import Live

    return Live(Design.read(design), source, parse_map(mapping), estimated_names(estimate))


WORKBENCH_COMMANDS = (workbench,)
