"""The documentation stays short enough to be read.

Counted are words (with a letter or a digit) of the README and the pages of `docs/`. What a command
writes, between two markers or as a whole page, is there to look something up: not counted.
"""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = [*sorted((ROOT / "docs").glob("*.md")), ROOT / "README.md"]
TABLE = re.compile(r"<!-- (\w+) -->.*?<!-- /\1 -->", re.S)
ON_A_PAGE = 2_500


def words(text: str) -> int:
    """Return the number of words that somebody wrote."""
    if text.startswith("<!-- Written by"):
        return 0
    return sum(bool(re.search(r"\w", word)) for word in TABLE.sub("", text).split())


def test_no_page_is_longer_than_a_reader_reads():
    found = {page.name: words(page.read_text(encoding="utf-8")) for page in PAGES}
    assert {name: count for name, count in found.items() if count > ON_A_PAGE} == {}


def test_the_readme_is_a_page_or_two():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 120


def test_what_is_generated_is_not_counted():
    assert words("two words\n<!-- t -->\n| many | more |\n<!-- /t -->\n| a |\n") == 3
