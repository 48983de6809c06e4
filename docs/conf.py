"""How the site is built: ``sphinx-build -W -c docs . FOLDER`` from the repository's root.

The source folder is the root, so that pages, README and the configuration's reference link each
other, their figures and the code by paths that hold in the repository as well.
"""

import re
from pathlib import Path

from pygments.lexers.special import TextLexer

import expertaug

project = "expertaug"
author = "The expertaug authors"
release = expertaug.__version__
version = ".".join(release.split(".")[:2])

root_doc = "docs/index"
include_patterns = ["docs/**", "README.md", "CHANGELOG.md", "CONTRIBUTING.md", "config/README.md"]
include_patterns += ["benchmarks/README.md", "results/published/search/README.md"]
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
]

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4
# Notebooks are kept with what they print; tests/test_notebooks.py runs their cells.
nb_execution_mode = "off"

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


def _lead_in(app, error: Exception | None) -> None:
    """The site's root, which a browser asks for index.html, leads to the front page."""
    if error is None and app.builder.format == "html":
        page = f"{root_doc}.html"
        text = f'<!doctype html><meta charset="utf-8"><title>{project}</title>'
        text += f'<meta http-equiv="refresh" content="0; url={page}"><a href="{page}">{project}</a>'
        (Path(app.outdir) / "index.html").write_text(f"{text}\n", encoding="utf-8")


def setup(app) -> None:
    app.add_lexer("mermaid", TextLexer)  # the repository's own pages draw it
    app.connect("autodoc-process-docstring", _escape_shapes)
    app.connect("build-finished", _lead_in)
