"""The documentation's site names all that the package offers."""

import re
from pathlib import Path

import expertaug as ea

DOCS = Path(__file__).parents[1] / "docs"


def test_the_api_page_has_every_public_name():
    page = (DOCS / "api.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"^\.\. auto(?:function|class|exception):: expertaug\.(\w+)$", page, re.M))
    modules = set(re.findall(r"^\.\. automodule:: expertaug\.api\.(\w+)$", page, re.M))
    assert listed | modules == set(ea._EXPORTS)


def test_every_page_is_in_the_contents():
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    pages = {path.stem for path in (*DOCS.glob("*.md"), *DOCS.glob("*/*.ipynb"))} - {"index"}
    assert pages <= {Path(line).name for line in index.splitlines()}
