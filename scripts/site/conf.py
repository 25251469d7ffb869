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
author = "the Tombo authors"
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
