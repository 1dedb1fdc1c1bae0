"""The command fleet: logs of many axes to a table of results."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pmsm_ctrl.console import finish, progress_bar
from pmsm_ctrl.options import ForceOption, JsonOption, MapOption

if TYPE_CHECKING:
    from pmsm_ctrl.fleet import Manifest

__all__ = ["FLEET_COMMANDS"]


def fleet(
    words: Annotated[
        list[str],
        typer.Argument(metavar="RUN.toml | FOLDER", help="a manifest, or a folder of logs with --design"),
    ],
    design: Annotated[
        Path | None, typer.Option("--design", "-d", metavar="DESIGN", help="design of every axis of a folder")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="RESULTS", help="folder of the results; results if left out"),
    ] = None,
    jobs: Annotated[
        int, typer.Option("--jobs", "-j", metavar="N", min=0, help="worker processes; 0: one per core; 1: none")
    ] = 0,
    scheduler: Annotated[
        str, typer.Option("--scheduler", metavar="ADDRESS", help="a running dask scheduler: tcp://HOST:8786")
    ] = "",
    memory: Annotated[
        str, typer.Option("--memory", metavar="SIZE", help="limit of a worker, such as 2GB; auto shares the machine's")
    ] = "auto",
    joint: Annotated[bool, typer.Option("--joint", help="evaluate the records of an axis together")] = False,
    mapping: MapOption = None,
    json_file: JsonOption = None,
    force: ForceOption = False,
) -> None:
    """Evaluate the logs of many axes into one table. What is done is not done again."""
    from pmsm_ctrl.fleet import Engine
    from pmsm_ctrl.fleet import fleet as run_fleet

    manifest = _manifest(words, design, output, joint, mapping)
    with progress_bar(f"fleet {words[0]}") as progress:
        result = run_fleet(manifest, engine=Engine(jobs, scheduler, memory), progress=progress)
    finish("fleet", result, json_file=json_file)


def _manifest(
    words: list[str], design: Path | None, output: Path | None, joint: bool, mapping: list[str] | None
) -> Manifest:
    """Return the manifest of a file, or of folders of logs."""
    from dataclasses import replace

    from pmsm_ctrl.console import parse_map
    from pmsm_ctrl.errors import RequestError
    from pmsm_ctrl.fleet import Manifest, read_manifest

    if len(words) == 1 and words[0].endswith(".toml"):
        if design is not None:
            raise RequestError("--design: excludes a manifest, which names its own designs")
        manifest = read_manifest(words[0])
    elif design is None:
        raise RequestError(f"fleet {words[0]}: a manifest that ends in .toml, or --design was expected")
    else:
        manifest = Manifest(logs=tuple(words), design=str(design))
    settings = manifest.settings
    settings = replace(settings, joint=joint or settings.joint, mapping={**settings.mapping, **parse_map(mapping)})
    return replace(manifest, settings=settings, results=str(output) if output is not None else manifest.results)


FLEET_COMMANDS = (fleet,)
