"""Every name in the glossary's column *in code* exists in the sources."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROWS = [
    line.split(" | ")
    for line in (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8").splitlines()
    if line.startswith("| ") and not line.startswith("| term")
]
NAMES = [(row[0].strip("| "), name) for row in ROWS for name in re.findall(r"`([^`]+)`", row[1])]


@pytest.fixture(scope="module")
def files() -> list[set[str]]:
    """Return the words of each source, message and YAML file, with its own name."""
    words_of_files = []
    for path in (ROOT / "tombo_ws" / "src").rglob("*"):
        if path.suffix in (".py", ".msg", ".yaml"):
            words = re.findall(r"\w+", path.read_text(encoding="utf-8"))
            words_of_files.append({*words, path.stem, path.suffix[1:], *path.parent.parts})
    return words_of_files


def test_glossary_has_rows_of_four_columns():
    assert 0 < len(ROWS) <= 120  # what a reader needs; the rest stands in docstrings
    assert {len(row) for row in ROWS} == {4}


def test_glossary_lists_a_term_once():
    terms = [row[0] for row in ROWS]
    assert sorted(set(terms)) == sorted(terms)


@pytest.mark.slow
def test_names_of_the_glossary_are_in_the_code(files):
    def exists(name: str) -> bool:
        parts = set(re.findall(r"[A-Za-z_]\w*", name))
        return any(parts <= words for words in files)

    assert [f"{term}: {name}" for term, name in NAMES if not exists(name)] == []
