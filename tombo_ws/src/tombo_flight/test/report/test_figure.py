"""A figure inside a page: SVG in the page's colours and font."""

import re

import pytest

from tombo_flight.report import style
from tombo_flight.report.figure import inline_svg, new_figure


@pytest.mark.slow
def test_a_figure_in_a_page_takes_its_colours_and_font_and_loads_nothing():
    with new_figure(4.0, 2.0, 100) as sheet:
        axes = sheet.add_subplot()
        axes.plot([0, 1, 2], [1, 3, 2], ".", color=style.VERMILLION, alpha=0.25)
        axes.plot([0, 1, 2], [2, 1, 3], color=style.BLUE)
        axes.set_xlabel("<b>time</b> of 0.62 s [s]", parse_math=False)
        svg = inline_svg(sheet, 'a "name" <of it>')
    assert svg.startswith('<svg viewBox="0 0 288 144" role="img" aria-label="a &quot;name&quot;')
    assert not re.search(r"https?:|<style|font-family|url\((?!#)|#[0-9a-fA-F]{6}\b", svg)
    assert (
        "var(--vermillion)" in svg
        and "var(--blue)" in svg
        and "&lt;b&gt;time&lt;/b&gt; of 0.62 s" in svg
    )
    for name in re.findall(r"#([\w-]+)", svg):
        assert f'id="{name}"' in svg
