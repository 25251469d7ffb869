"""Pictures and figures of the documentation come from the code as it is."""

from __future__ import annotations

import json
import shutil

import yaml
from PIL import Image

from tombo_benchmarks.docs.__main__ import ROOT
from tombo_benchmarks.docs.evidence_pictures import TABLES
from tombo_benchmarks.docs.markdown import marked, table_rows
from tombo_benchmarks.docs.products import CAMPAIGN, PRODUCTS, campaign_table, two_modes
from tombo_benchmarks.docs.site_source import arrows


def test_tables_of_the_pages_are_what_the_code_gives(tmp_path):
    product = PRODUCTS["tables"]
    files = {place.partition("#")[0] for place in product.written}
    for file in files:
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / file, tmp_path / file)
    product.make(tmp_path, tmp_path)
    changed = {f for f in files if (ROOT / f).read_bytes() != (tmp_path / f).read_bytes()}
    assert changed == set(), "run: make docs ARGS=tables"


DRAWN_ONCE = {"docs/frames.png", "docs/propeller.png", "docs/live.png", "docs/report.png"}
"""Drawings of conventions, and pages as a browser shows them."""


def test_every_picture_of_the_docs_is_a_product():
    pictures = {f"docs/{path.name}" for path in (ROOT / "docs").glob("*.png")} - DRAWN_ONCE
    assert pictures == {
        p for product in PRODUCTS.values() for p in product.written if p.endswith(".png")
    }


def test_pictures_of_the_evidence_show_the_tables_of_today():
    for picture, (page, table) in TABLES.items():
        rows = table_rows(marked((ROOT / "docs" / page).read_text(encoding="utf-8"), table))
        shown = Image.open(ROOT / "docs" / picture).text["Description"]
        assert json.loads(shown) == rows, "run: make docs ARGS=evidence"


def test_every_page_is_in_the_index_of_the_site():
    index = (ROOT / "scripts" / "site" / "index.md").read_text().splitlines()
    assert [
        page.stem for page in (ROOT / "docs").glob("*.md") if f"docs/{page.stem}" not in index
    ] == []


def test_readme_has_the_figures_of_the_campaign():
    values = yaml.load((ROOT / CAMPAIGN).read_text(), Loader=yaml.BaseLoader)
    assert marked((ROOT / "README.md").read_text(), "campaign") == campaign_table(values)


def test_the_site_has_a_row_for_each_arrow_of_a_diagram():
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    rows = arrows(marked(page, "wiring")).splitlines()[2:]
    assert len(rows) == marked(page, "wiring").count("-->")
    assert "| sim | mocap/pose, imu/data_raw | estimator |" in rows
    assert arrows('a["A<br/>B"] -- x --> b\nb -- "y" --> c["C"]').splitlines()[2:] == [
        "| A, B | x | b |",
        "| b | y | C |",
    ]


def test_two_modes_are_split_at_the_widest_gap():
    assert two_modes([0.1, 0.2, 0.6, 0.65, 0.7]) == ([0.1, 0.2], [0.6, 0.65, 0.7])
    assert two_modes([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]) == ([0.1, 0.2, 0.3, 0.4, 0.5, 0.6],)
    assert two_modes([]) == ([],)
