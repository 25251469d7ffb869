"""Sphinx, for `make site`: pages in Markdown, search in the browser, nothing from a network."""

import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
for package in sorted((ROOT / "tombo_ws" / "src").iterdir()):
    sys.path.insert(0, str(package))
# numpy and what else the packages import; after the site's own libraries.
sys.path += map(str, (ROOT / ".venv" / "lib").glob("python*/site-packages"))
os.environ.setdefault("NUMBA_DISABLE_JIT", "1")

project = "Tombo"
release = os.environ.get("TOMBO_VERSION", "")
html_title = f"Tombo {release}"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
html_theme = "furo"
html_copy_source = False
html_show_sourcelink = False
exclude_patterns = ["tombo_ws", "tests", "examples"]
myst_heading_anchors = 4
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"show-inheritance": True}
html_show_search_summary = False  # it would fetch pages, which a file opened in a browser may not
html_show_copyright = False
python_maximum_signature_line_length = 88
ARRAY = "numpy.ndarray[tuple[int, ...], numpy.dtype[numpy.float64]]"


def setup(app):
    """Write the type of an array as the sources do."""

    def shorter(_app, _what, _name, _obj, _options, signature, returns):
        return tuple(
            text and text.replace("~", "").replace(ARRAY, "Array").replace("numpy.dtype", "dtype")
            for text in (signature, returns)
        )

    app.connect("autodoc-process-signature", shorter)
