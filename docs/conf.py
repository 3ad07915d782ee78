"""Sphinx configuration: `make docs` builds the pages into docs/_build/html."""

from beltid import __version__

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
