"""How the documentation's site is built: ``sphinx-build -W -c docs . FOLDER`` from the repository's root.

The source folder is the root, so that pages, README and the configuration's reference link each other, their figures
and the code by paths that hold in the repository as well.
"""

import re

from pygments.lexers.special import TextLexer

import expertaug

project = "expertaug"
author = "The expertaug authors"
release = expertaug.__version__
version = ".".join(release.split(".")[:2])

root_doc = "docs/index"
include_patterns = ["docs/**", "README.md", "CHANGELOG.md", "CONTRIBUTING.md", "config/README.md"]
include_patterns += ["benchmarks/README.md", "results/published/search/README.md"]
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode", "sphinx_copybutton"]

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4
nb_execution_mode = "off"  # notebooks are kept with what they print; tests/test_notebooks.py runs their cells

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
napoleon_numpy_docstring = False
napoleon_custom_sections = [("Arguments", "params_style")]

html_theme = "furo"
html_title = "expertaug"
html_copy_source = False


def _escape_shapes(app, what, name, obj, options, lines: list[str]) -> None:
    """Shapes are written (N, T, *state), which is no emphasis."""
    lines[:] = [re.sub(r"(?<![*\w])\*(?=[a-z]+[),.])", r"\*", line) for line in lines]


def setup(app) -> None:
    app.add_lexer("mermaid", TextLexer)  # the repository's own pages draw it
    app.connect("autodoc-process-docstring", _escape_shapes)
