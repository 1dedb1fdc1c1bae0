"""The pictures of the pages: drawn by the package, small, spoken, and each on a page."""

from __future__ import annotations

import importlib.util
import re
import xml.etree.ElementTree as ET
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
LARGEST = 60_000  # bytes
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
SHOWN = re.compile(r"!\[([^\]]+)\]\(([^)\s]+)\)")


@pytest.fixture(scope="module")
def pictures() -> ModuleType:
    spec = importlib.util.spec_from_file_location("pictures", ROOT / "docs" / "pictures.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def shown() -> dict[Path, str]:
    """Return the pictures of all pages with the words for who does not see them."""
    found = ((page, match) for page in PAGES for match in SHOWN.finditer(page.read_text(encoding="utf-8")))
    return {(page.parent / match[2]).resolve(): match[1] for page, match in found}


def test_every_picture_is_drawn_by_the_package_and_on_a_page(pictures: ModuleType) -> None:
    tracked = {path.stem for path in pictures.FOLDER.iterdir()}
    assert tracked == set(pictures.PICTURES)
    on_pages = shown()
    assert all(path.is_file() for path in on_pages)
    assert {pictures.FOLDER / f"{name}.svg" for name in tracked} <= set(on_pages)
    assert len(on_pages) >= 14  # there was one image in 23,000 words
    assert all(len(words) > 40 for words in on_pages.values())


def test_a_picture_is_small_and_asks_for_nothing(pictures: ModuleType) -> None:
    for path in pictures.FOLDER.iterdir():
        text = path.read_text(encoding="utf-8")
        assert path.stat().st_size < LARGEST, path.name
        root = ET.fromstring(text)
        assert root.tag == "{http://www.w3.org/2000/svg}svg"
        assert root.get("aria-label")
        assert not re.search(r'href="(?!#)|<script|url\((?!#)', text), path.name


def test_a_picture_drawn_again_is_the_same(pictures: ModuleType) -> None:
    again, kept = pictures.drawn("sweep"), (pictures.FOLDER / "sweep.svg").read_text(encoding="utf-8")
    for mark in ("<path", "<use", "<g"):
        assert again.count(mark) == pytest.approx(kept.count(mark), rel=0.05), mark
