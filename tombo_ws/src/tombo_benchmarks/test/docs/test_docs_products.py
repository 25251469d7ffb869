"""Pictures and figures of the documentation come from the code as it is."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml

from tombo_benchmarks.docs.__main__ import ROOT, out_of_date
from tombo_benchmarks.docs.lock import code_hash, content_hash, reference_flights
from tombo_benchmarks.docs.markdown import marked
from tombo_benchmarks.docs.products import CAMPAIGN, PRODUCTS, Product, campaign_table, two_modes
from tombo_benchmarks.docs.tables import wiring_mermaid

DATA = ROOT.parent / "shared" / "data"


@pytest.fixture(scope="module")
def flights():
    return reference_flights()


@pytest.mark.parametrize("product", PRODUCTS, ids=lambda product: product.name)
def test_product_comes_from_the_code_as_it_is(product, flights):
    found = out_of_date(product, flights)
    if found and product.data is not None and not (DATA / product.data).is_dir():
        pytest.skip(f"{found[0]}; but no '{DATA / product.data}' here")
    assert found == []


def test_a_file_that_the_code_gives_otherwise_is_out_of_date():
    def make(root: Path, data: Path) -> None:
        (root / "README.md").write_text("other words")

    found = out_of_date(Product("readme", ("README.md", "LICENSE"), make, quick=True))
    assert found == ["README.md is not what the code gives; run `make docs ARGS=readme`"]


def test_every_picture_of_the_docs_is_a_product():
    pictures = {f"docs/{path.name}" for path in (ROOT / "docs").glob("*.png")}
    assert pictures == {p for product in PRODUCTS for p in product.written if p.endswith(".png")}


def test_readme_has_the_figures_of_the_campaign():
    values = yaml.load((ROOT / CAMPAIGN).read_text(), Loader=yaml.BaseLoader)
    assert marked((ROOT / "README.md").read_text(), "campaign") == campaign_table(values)


def test_wiring_is_drawn_with_an_arrow_per_publisher_and_subscriber():
    core = SimpleNamespace
    cores = [
        core(name="estimator", inputs=("/pose", "/imu"), outputs=("/odometry",)),
        core(name="controller", inputs=("/imu", "/odometry"), outputs=("/command",)),
    ]
    assert wiring_mermaid(cores, ("/pose", "/imu"), "/command").splitlines()[2:-1] == [
        '    sim -- "pose<br/>imu" --> estimator',
        '    sim -- "imu" --> controller',
        '    estimator -- "odometry" --> controller',
        '    controller -- "command" --> sim',
    ]


def test_two_modes_are_split_at_the_widest_gap():
    assert two_modes([0.1, 0.2, 0.6, 0.65, 0.7]) == ([0.1, 0.2], [0.6, 0.65, 0.7])
    assert two_modes([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]) == ([0.1, 0.2, 0.3, 0.4, 0.5, 0.6],)
    assert two_modes([]) == ([],)


def test_hash_of_code_leaves_out_comments_and_docstrings(tmp_path):
    source = tmp_path / "tombo_ws" / "src" / "a" / "b.py"
    source.parent.mkdir(parents=True)

    def found(text: str) -> str:
        source.write_text(text)
        return code_hash(tmp_path, ["a"])

    first = found('"""Words."""\n\n\ndef f():\n    """More."""\n    return 1\n')
    assert found('"""Other."""\n\n\n# why\ndef f():\n    """New."""\n    return 1\n') == first
    assert found('"""Words."""\n\n\ndef f():\n    """More."""\n    return 2\n') != first


def test_hash_of_content_is_that_between_the_markers(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("a\n<!-- t -->\nrow\n<!-- /t -->\nb\n")
    first = content_hash(tmp_path, "page.md#t")
    page.write_text("other\n<!-- t -->\nrow\n<!-- /t -->\n")
    assert content_hash(tmp_path, "page.md#t") == first
    page.write_text("a\n<!-- t -->\nedited\n<!-- /t -->\nb\n")
    assert content_hash(tmp_path, "page.md#t") != first
    assert content_hash(tmp_path, str(Path("no.md"))) == "missing"
