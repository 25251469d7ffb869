"""A page says the same in a browser, on a terminal and to programs."""

from __future__ import annotations

import io
import json

from page_reader import PageReader, loads_nothing
from rich.console import Console

from tombo_flight.report.page import (
    Card,
    Cell,
    Folded,
    Group,
    Page,
    Picture,
    Section,
    Table,
    TableRow,
    Text,
    page_html,
    page_json,
)
from tombo_flight.report.style import new_figure
from tombo_flight.report.terminal import print_page

HOSTILE = "<script>alert('x')</script> & [bold]"


def figure():
    with new_figure(3.0, 2.0, 100) as drawn:
        drawn.subplots().plot([0.0, 1.0], [2.0, 3.0])
    return drawn


def page(**changed) -> Page:
    table = Table(
        ("name", "value [m]"),
        [
            TableRow(["Group of rows"], "group"),
            ("plain", "1.25"),
            TableRow(
                [Cell("marked", "bad", small="small text"), Cell("-3.5", bar=0.5)], anchor="place"
            ),
        ],
        note="Note of the table.",
    )
    sections = [
        Section(
            "Shown by both", [table, Text(["A sentence."], "list"), Picture(figure, "Caption")]
        ),
        Section("Page alone", [Folded("Folded", [Text(["Inside."])])], "page"),
        Section("Terminal alone", [Text(["For the terminal."])], "terminal"),
        Section("", [Group([Text(["In a group."], "heading")], "block")]),
        Section("Section without items", []),
    ]
    values = {
        "title": "Tab", "eyebrow": "Eyebrow", "headline": "Headline", "summary": "Summary.",
        "sections": sections, "cards": [Card("fall", "0.5", "m", "paper 0.5 m")],
        "verdict": "passed", "verdict_style": "good", "footer": "Footer.", "data": {"fall": 0.5},
    }  # fmt: skip
    return Page(**{**values, **changed})


def terminal_text(shown: Page, width: int = 100) -> str:
    out = io.StringIO()
    print_page(shown, Console(file=out, width=width))
    return out.getvalue()


def test_browser_and_terminal_show_the_same_facts():
    browser, terminal = PageReader(page_html(page())).text, terminal_text(page())
    for fact in (
        "Headline", "Summary.", "passed", "fall", "0.5", "paper 0.5 m", "Shown by both",
        "Group of rows", "plain", "1.25", "marked", "small text", "-3.5", "value [m]",
        "Note of the table.", "A sentence.", "In a group.",
    ):  # fmt: skip
        assert fact in browser and fact in terminal, fact
    assert "Caption" in browser and "Inside." in browser and "Footer." in browser
    assert "For the terminal." in terminal and "For the terminal." not in browser
    assert "Inside." not in terminal and "Section without items" not in browser + terminal
    assert json.loads(page_json(page())) == {"fall": 0.5}


def test_texts_of_items_are_never_read_as_markup():
    items = [
        Table([HOSTILE], [[Cell(HOSTILE, small=HOSTILE, tooltip=HOSTILE)]], title=HOSTILE),
        Text([HOSTILE], "command"),
        Picture(figure, HOSTILE, name=HOSTILE),
        Folded(HOSTILE, [Text([HOSTILE])]),
    ]
    shown = page(sections=[Section(HOSTILE, items)], cards=[Card(HOSTILE, HOSTILE)])
    html = page_html(shown)
    assert "<script" not in html
    PageReader(html)
    assert terminal_text(shown).count(HOSTILE) >= 6


def test_a_page_loads_nothing_and_allows_no_script_unless_it_has_one():
    html = page_html(page())
    loads_nothing(html, PageReader(html))
    assert "script-src" not in html
    assert "script-src 'unsafe-inline'" in page_html(page(scripts="<script>1</script>"))
