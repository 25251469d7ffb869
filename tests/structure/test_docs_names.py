"""Files and classes that the documentation names exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SRC = ROOT / "tombo_ws" / "src"
PAGES = [*sorted((ROOT / "docs").glob("*.md")), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
SOURCES = [
    path
    for folder in ("tombo_ws/src", "tests", "examples", "docker", "scripts")
    for path in (ROOT / folder).rglob("*")
    if path.suffix in (".py", ".msg", ".yaml", ".sh")
]


@pytest.fixture(scope="module")
def words() -> set[str]:
    return {
        word for path in SOURCES for word in [*re.findall(r"\w+", path.read_text()), path.stem]
    }


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_that_a_page_names_exist(page):
    text = page.read_text(encoding="utf-8")
    found = set(re.findall(r"[`/]([\w/]+\.(?:py|msg))\b", text))
    found -= set(re.findall(r"[Ss]ave [^`]*as `([\w/]+\.py)`", text))  # by the reader
    names = {str(path.relative_to(ROOT)) for path in SOURCES}
    folders = re.findall(r"`((?:docker|tests|tombo_(?!msgs)\w+)/[\w/]+)`", text)
    places = (ROOT, SRC, *SRC.iterdir())
    assert [n for n in folders if not any((place / n).exists() for place in places)] == []
    assert {n for n in found if not any(f"/{name}".endswith(f"/{n}") for name in names)} == set()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_classes_that_a_page_names_exist(page, words):
    text = page.read_text(encoding="utf-8")
    if page.name == "glossary.md":
        return  # its own test; the last column has names of other projects
    found = set(re.findall(r"`([A-Z][a-z]+[A-Z]\w+)[`(.]", text))
    assert found - words == set()
