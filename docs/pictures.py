"""The pictures of the pages: `python docs/pictures.py [NAME ...]` draws them again, into docs/pictures/.

Each is a figure of the package, of the logs that the page beside it speaks of. They are tracked, so that the pages show
them without a build.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pmsm_ctrl import Design, Log

HERE = Path(__file__).resolve().parent
FOLDER = HERE / "pictures"
TUTORIAL = HERE / "tutorials" / "your_log.md"


@contextlib.contextmanager
def _scratch() -> Iterator[Path]:
    """Run in a folder of its own, and say nothing."""
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as name, contextlib.redirect_stdout(io.StringIO()):
        os.chdir(name)
        try:
            yield Path(name)
        finally:
            os.chdir(before)


def _command(*words: str) -> None:
    from pmsm_ctrl.cli import app
    from pmsm_ctrl.console import run

    status = run(app, list(words))
    if status:
        raise RuntimeError(f"{' '.join(words)}: status {status}")


@cache
def conveyor() -> tuple[Design, list[Log]]:
    """Return the tuned design and the three logs of the tutorial, by its own commands and its own code."""
    import shlex

    from pmsm_ctrl import Design, read_log

    page = TUTORIAL.read_text(encoding="utf-8")
    shell = [block.replace("\\\n", " ") for block in re.findall(r"```bash\n(.*?)```", page, re.DOTALL)]
    code = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    with _scratch():
        for block in shell[:2]:
            _command(*shlex.split(block)[1:])
        exec(compile(code[0], str(TUTORIAL), "exec"), {"__name__": "tutorial"})
        mapping = {"t": "Zeit", "omega": "Drehzahl", "theta": "Istwinkel", "i_q": "Strom Iq [A peak]"}
        design = Design.read("tuned.toml")
        return design, [read_log(f"{day}.csv", design, mapping) for day in ("monday", "tuesday", "wednesday")]


def _of(result: Any, words: str) -> Figure:
    """Return the figure of a result whose caption holds these words."""
    from pmsm_ctrl.result import _pictures, present

    return next(one for one in _pictures(present(result).blocks) if words in one.caption).draw()


def sweep() -> Figure:
    """Friction from a speed staircase."""
    from pmsm_ctrl import Design, sweep

    return _of(sweep(Design.example("seed_motor")), "points lie on the line")


def tuned() -> Figure:
    """The speed loop of the tutorial's axis."""
    from pmsm_ctrl import tune
    from pmsm_ctrl.tune.figures import bode

    return bode(tune(conveyor()[0], prove=False))


def identified() -> Figure:
    """What identification leaves of the torque where an effect is missing."""
    from pmsm_ctrl import identify

    design, logs = conveyor()
    return _of(identify(design, logs[0]), "look like noise")


def worst() -> Figure:
    """Where the model of the tutorial fails on the third log."""
    from pmsm_ctrl import compare, identify

    design, logs = conveyor()
    return _of(compare(identify(design, logs[:2]).design, logs[2]), "worst stretches, with")


@cache
def _diagnosed() -> Any:
    from pmsm_ctrl import diagnose

    design, logs = conveyor()
    return diagnose(design, logs[:2], holdout=logs[2], plan=False)


def falling() -> Figure:
    """The error of the tutorial's axis, model by model."""
    return _of(_diagnosed(), "Every step is an accepted effect")


def parts() -> Figure:
    """What every part of the final model contributes over speed."""
    return _of(_diagnosed(), "What every part of the final model contributes")


@cache
def _compensated() -> Any:
    from pmsm_ctrl import Design, compensate

    return compensate(Design.example("low_speed"), gains=[0.25 * k for k in range(7)])


def gains() -> Figure:
    """Limit cycles over the gain: the windows of the compensation."""
    from pmsm_ctrl.compensate.figures import gain_sweep

    return gain_sweep(_compensated())


def reversal() -> Figure:
    """A reversal with and without compensation."""
    from pmsm_ctrl.result import _pictures, present

    return next(one for one in _pictures(present(_compensated()).blocks) if "evers" in one.caption).draw()


def response() -> Figure:
    """The measured frequency response of an axis with a spring, over that of the rigid design."""
    from pmsm_ctrl import Design, frf, simulate
    from pmsm_ctrl.frf.figures import plant
    from pmsm_ctrl.simulate import scenario

    design = Design.example("seed_motor")
    truth = design.with_effect("compliance", {"J_load": 4e-5, "k": 20.0, "d": 2e-3})
    return plant(frf(design, simulate(design, scenario("multisine", design), truth=truth, seed=4)))


def nights() -> Figure:
    """Friction and unbalance of an axis of the fleet of the tutorial, night by night."""
    from pmsm_ctrl.fleet import fleet_report
    from pmsm_ctrl.fleet.figures import series_figure

    with _scratch():
        _command("fleet", "example", "night", "--jobs", "1", "--report", "night.html")
        axis = fleet_report("night/results").axes[0]
        return series_figure([axis.series[name] for name in ("F_c", "F_v", "unbalance.a_s")], {})


PICTURES: dict[str, Callable[[], Figure]] = {
    one.__name__: one for one in (sweep, tuned, identified, worst, falling, parts, gains, reversal, response, nights)
}


def drawn(name: str) -> str:
    """Return a picture as SVG: curves keep to their course within a point, and places to a tenth."""
    from pmsm_ctrl.rendering.svg import inline_svg

    def draw() -> Figure:
        import matplotlib

        with matplotlib.rc_context({"path.simplify_threshold": 1.0}):
            figure = PICTURES[name]()
        figure.set_size_inches(0.85 * figure.get_size_inches())  # a page is narrower than a report
        return figure

    about = " ".join((PICTURES[name].__doc__ or "").split())
    text = inline_svg(draw, name[0], about)
    text = re.sub(r' d="[^"]*"', lambda found: re.sub(r"(\.\d)\d+", r"\1", found[0]), text)
    width, height = re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', text).groups()  # type: ignore[union-attr]
    return text.replace("<svg ", f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}pt" height="{height}pt" ', 1)


def main() -> None:
    """Draw the pictures that are named, or all."""
    FOLDER.mkdir(exist_ok=True)
    for name in sys.argv[1:] or PICTURES:
        path = FOLDER / f"{name}.svg"
        path.write_text(drawn(name) + "\n", encoding="utf-8")
        print(f"{path} {path.stat().st_size / 1e3:.0f} kB", flush=True)


if __name__ == "__main__":
    main()
