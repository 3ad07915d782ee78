"""Sphinx configuration: `make docs` builds the pages into docs/_build/html."""

import json
from pathlib import Path

from beltid import __version__
from beltid.export.law import schema

project = "beltid"
author = "the beltid authors"
copyright = "2026, the beltid authors"
release = version = __version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.mathjax"]
exclude_patterns = ["_build"]
myst_enable_extensions = ["dollarmath", "amsmath", "deflist"]
myst_heading_anchors = 3
napoleon_google_docstring = False
napoleon_use_rtype = False
autodoc_typehints = "none"  # the docstrings tell types, units and shapes
autodoc_member_order = "bysource"
html_theme = "furo"
html_title = f"beltid {release}"
html_copy_source = False


def setup(app):
    """Connect what the build also does."""
    app.connect("build-finished", write_schema)


def write_schema(app, exception):
    """Write the JSON Schema of the law file beside the pages."""
    text = json.dumps(schema(), indent=2, ensure_ascii=False) + "\n"
    Path(app.outdir, "beltlaw.schema.json").write_text(text, "utf-8")
