"""Every Python and shell block of the README and of docs/ runs, page by page; the printed page is fresh.

A page runs in a folder of its own that looks like the project: `designs/` beside it, measured data at
`../shared/data`. Blocks that need that data are left out, loudly, where there is none. A block under a comment
``<!-- command: ... -->`` is run by CI instead, one under ``<!-- not run: why -->`` by nobody.
"""

from __future__ import annotations

import importlib.util
import os
import re
import runpy
import shlex
import subprocess
import sys
import warnings
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from pmsm_ctrl.cli import main

ROOT = Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"(?:<!-- (?P<mark>[\w ]+): [^\n]*-->\n)?```(?P<language>python|bash)\n(?P<code>.*?)```", re.DOTALL)
PAGES = [
    path
    for path in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
    if BLOCK.search(path.read_text("utf-8")) and "printed" not in path.parts
]
DATA = "shared/data"
# Pages that take half a minute each; what they call is tested elsewhere, and that their commands exist below.
LONG = (
    "docs/adding_an_effect.md",
    "docs/compensation.md",
    "docs/diagnosis.md",
    "docs/export.md",
    "docs/frf.md",
    "docs/tutorials/compensator.md",
    "docs/tutorials/emps.md",
    "docs/tutorials/fleet.md",
    "docs/tutorials/your_log.md",
    "docs/tracking.md",
    "docs/verify.md",
    "docs/workbench.md",
)


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder that a page may write into, with what pages read beside it."""
    from tests.conftest import data_folder

    here = tmp_path / "main"
    here.mkdir()
    for name in ("designs", "tests", "docs", "pyproject.toml"):
        (here / name).symlink_to(ROOT / name)
    if data_folder().is_dir():
        (tmp_path / "shared").mkdir()
        (tmp_path / "shared" / "data").symlink_to(data_folder().resolve())
    monkeypatch.chdir(here)
    return here


def run_block(code: str, page: Path) -> None:
    """Run a shell block as a user would paste it; commands of the package run in this process, which has loaded it."""
    for line in code.replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        if words[:1] == ["pmsm-ctrl"]:
            with warnings.catch_warnings():
                warnings.simplefilter("default")  # as outside the tests
                with pytest.raises(SystemExit) as left:
                    main(words[1:])
            assert not left.value.code, f"{page.name}: {line}"
        elif words:
            run_shell(line, page)


def run_shell(code: str, page: Path) -> None:
    """Run a line with the commands of this environment first on the path."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", code], capture_output=True, text=True, check=False, timeout=600,
        env=os.environ | {"PATH": path}, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    assert done.returncode == 0, f"{page.name}:\n{code}\n{done.stdout[-2000:]}\n{done.stderr}"


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


@cache
def commands() -> Mapping[str, Any]:
    """Return the commands of the command line by name."""
    from typer.main import get_command

    from pmsm_ctrl.cli import app

    found: Mapping[str, Any] = get_command(app).commands  # type: ignore[attr-defined]
    return found


@pytest.mark.parametrize("page", [ROOT / name for name in LONG], ids=name_of)
def test_commands_of_a_long_page_exist(page: Path) -> None:
    """Every command with its options is one of the command line, and every Python block compiles."""
    for block in BLOCK.finditer(page.read_text(encoding="utf-8")):
        if block["language"] == "python":
            compile(block["code"], page.name, "exec")
            continue
        for line in block["code"].replace("\\\n", " ").splitlines():
            words = shlex.split(line, comments=True)
            if words[:1] == ["pmsm-ctrl"]:
                verb = commands()[words[1]]
                verb.make_context(words[1], words[2:], resilient_parsing=False)


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=pytest.mark.slow) if name_of(page) in LONG else page for page in PAGES],
    ids=name_of,
)
def test_blocks_run(page: Path, project: Path) -> None:
    scope: dict[str, object] = {"__name__": "page"}
    left_out = 0
    for number, block in enumerate(BLOCK.finditer(page.read_text(encoding="utf-8"))):
        if block["mark"] in ("command", "not run"):
            continue
        # What follows from measured data is named after it on these pages (emps.json): absent like the data.
        needs_data = DATA in block["code"] or (left_out and "emps" in block["code"])
        if needs_data and not (project.parent / "shared" / "data").is_dir():
            left_out += 1
        elif block["language"] == "bash":
            run_block(block["code"], page)
        else:
            # A real file name, because compiled functions look their source up.
            exec(compile(block["code"], f"{page}#{number}", "exec"), scope)
    if left_out:
        pytest.skip(f"MEASURED DATA ABSENT: {left_out} blocks of {page.name} were not run (set PMSM_CTRL_DATA)")


@pytest.fixture(scope="module")
def generate() -> ModuleType:
    spec = importlib.util.spec_from_file_location("generate", ROOT / "docs" / "generate.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_theory_page_is_what_the_source_prints(generate: ModuleType) -> None:
    written = (ROOT / "docs" / "theory.md").read_text(encoding="utf-8")
    assert written == generate.theory(), "run `python docs/generate.py`"


def test_every_effect_is_on_the_theory_page_with_its_source() -> None:
    from pmsm_ctrl.effects import CATALOGUE

    text = (ROOT / "docs" / "theory.md").read_text(encoding="utf-8")
    for effect in CATALOGUE.values():
        assert f"`{effect.id}`" in text
        assert effect.equation in text
        assert effect.source in text


def test_equations_of_the_machine_are_the_textbook_s(generate: ModuleType) -> None:
    """Krishnan 2010, eq. 3.63 and following, in this page's signs and scaling."""
    text = generate.machine()
    assert r"R\,i_{d} + L_{d}\,\dot i_d - p\,\omega\,L_{q}\,i_{q}" in text
    assert r"R\,i_{q} + L_{q}\,\dot i_q + p\,\omega\,\left(L_{d}\,i_{d} + \psi_{f}\right)" in text
    assert r"1.5\,p\,\left(\psi_{f}\,i_{q} + \left(L_{d} - L_{q}\right)\,i_{d}\,i_{q}\right)" in text


@pytest.mark.parametrize(
    ("source", "latex"),
    [("a - (b - c)", r"a - \left(b - c\right)"), ("a + b - c", "a + b - c"), ("a / (b + c)", r"\frac{a}{b + c}"),
     ("a * (b + c)", r"a\,\left(b + c\right)"), ("-a * omega", r"-a\,\omega"), ("psi_f_hat", r"\hat{\psi}_{f}")],
)  # fmt: skip
def test_source_to_latex_keeps_the_meaning(source: str, latex: str, generate: ModuleType) -> None:
    import ast

    assert generate.latex(ast.parse(source, mode="eval").body) == latex


def test_the_page_of_codes_has_every_notice(generate: ModuleType) -> None:
    page = generate.notices()
    sources = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "pmsm_ctrl").rglob("*.py"))
    codes = re.findall(r"(?:Template|Notice)\(\s*\"([a-z_]+)\"", sources)
    assert len(codes) > 100
    assert [code for code in codes if f"`{code}`" not in page] == []


def test_every_page_is_a_page_of_the_site_and_every_link_leads_somewhere(generate: ModuleType) -> None:
    printed = {f"printed/{name}" for name in generate.PAGES}  # made when the site is built
    for page in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md")):
        if "printed" in page.parts:
            continue
        for target in re.findall(r"\]\(([^)#:\s]+\.(?:md|html|svg|png|toml))\)", page.read_text(encoding="utf-8")):
            assert target in printed or (page.parent / target).exists(), f"{page.name}: {target}"


def test_every_file_that_the_map_of_contributing_names_exists() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    table = text.partition("## Where a change goes")[2].partition("\n## ")[0]
    named = set(re.findall(r"`([\w/]+(?:\.py|/))`", table))
    assert len(named) > 30
    assert [name for name in named if "/" in name and not (ROOT / "pmsm_ctrl" / name).exists()] == []


EXAMPLES = sorted((ROOT / "docs" / "examples").glob("*.py"))


@pytest.mark.slow
@pytest.mark.parametrize(
    "script",
    [
        pytest.param(path, id=path.stem, marks=[pytest.mark.slow] if path.stem == "plot_two_records" else [])
        for path in EXAMPLES
    ],
)
def test_every_notebook_of_the_gallery_runs(
    script: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In this process, which has loaded the package. The build of the site executes them too, and ends at an error."""
    from matplotlib import pyplot

    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("default")  # as outside the tests
        try:
            runpy.run_path(str(script), run_name="__main__")
        finally:
            pyplot.close("all")
    assert capsys.readouterr().out.strip()


def test_the_gallery_has_the_three_walks_and_its_errors_end_the_build() -> None:
    assert {path.stem for path in EXAMPLES} == {"plot_accepted", "plot_control_walk", "plot_two_records"}
    conf = (ROOT / "docs" / "conf.py").read_text(encoding="utf-8")
    assert '"abort_on_example_error": True, "plot_gallery": True' in conf
