"""Files, classes and terms that the documentation names exist, and its pages stay short."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SRC = ROOT / "tombo_ws" / "src"
PAGES = [*sorted((ROOT / "docs").glob("*.md")), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
EACH_PAGE = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
SOURCES = [
    path
    for folder in ("tombo_ws/src", "tests", "examples", "docker", "scripts")
    for path in (ROOT / folder).rglob("*")
    if path.suffix in (".py", ".msg", ".yaml", ".sh")
]
GLOSSARY = [
    line.split(" | ")
    for line in (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8").splitlines()
    if line.startswith("| ") and not line.startswith("| term")
]
GENERATED = re.compile(r"<!-- (\w+) -->.*?<!-- /\1 -->|\A<!-- Written by.*", re.S)
WORDS_ON_A_PAGE = 2_500
"""With a letter or a digit; the pages list the output of commands: not counted."""


@pytest.fixture(scope="module")
def source_words() -> dict[Path, set[str]]:
    """Return the words of each source, with the names of its file and folders."""
    return {
        path: {*re.findall(r"\w+", path.read_text()), path.stem, path.suffix[1:], *path.parts}
        for path in SOURCES
    }


@EACH_PAGE
def test_files_that_a_page_names_exist(page):
    text = page.read_text(encoding="utf-8")
    found = set(re.findall(r"[`/]([\w/]+\.(?:py|msg))\b", text))
    found -= set(re.findall(r"[Ss]ave [^`]*as `([\w/]+\.py)`", text))  # by the reader
    names = {str(path.relative_to(ROOT)) for path in SOURCES}
    folders = re.findall(r"`((?:docker|tests|tombo_(?!msgs)\w+)/[\w/]+)`", text)
    places = (ROOT, SRC, *SRC.iterdir())
    assert [n for n in folders if not any((place / n).exists() for place in places)] == []
    assert {n for n in found if not any(f"/{name}".endswith(f"/{n}") for name in names)} == set()


@EACH_PAGE
def test_classes_that_a_page_names_exist(page, source_words):
    if page.name == "glossary.md":
        return  # its own test; the last column has names of other projects
    found = set(re.findall(r"`([A-Z][a-z]+[A-Z]\w+)[`(.]", page.read_text(encoding="utf-8")))
    assert found - set().union(*source_words.values()) == set()


@EACH_PAGE
def test_no_page_is_longer_than_a_reader_reads(page):
    text = page.read_text(encoding="utf-8")
    count = sum(bool(re.search(r"\w", word)) for word in GENERATED.sub("", text).split())
    assert count <= WORDS_ON_A_PAGE or page.name == "CONTRIBUTING.md"


def test_names_of_the_glossary_are_in_the_code(source_words):
    code = [w for path, w in source_words.items() if SRC in path.parents and path.suffix != ".sh"]

    def exists(name: str) -> bool:
        parts = set(re.findall(r"[A-Za-z_]\w*", name))
        return any(parts <= found for found in code)

    names = [(row[0], name) for row in GLOSSARY for name in re.findall(r"`([^`]+)`", row[1])]
    assert [f"{term}: {name}" for term, name in names if not exists(name)] == []
