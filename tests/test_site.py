"""The documentation's site names all that the package offers."""

import re
import runpy
from pathlib import Path
from types import SimpleNamespace

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


def test_the_contents_have_four_shelves():
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    assert re.findall(r"^:caption: (.+)$", index, re.M) == ["Tutorials", "How-to", "Explanation", "Reference"]


def test_the_root_leads_to_the_front_page(tmp_path):
    lead_in = runpy.run_path(str(DOCS / "conf.py"))["_lead_in"]
    lead_in(SimpleNamespace(builder=SimpleNamespace(format="html"), outdir=tmp_path), None)
    assert 'url=docs/index.html"' in (tmp_path / "index.html").read_text(encoding="utf-8")


def test_headings_keep_what_stands_between_angle_brackets():
    """Markdown takes <name> for HTML, and shows nothing."""
    headings = re.findall(r"^#+ .*$", (DOCS.parent / "config" / "README.md").read_text(encoding="utf-8"), re.M)
    assert any("<name>" in heading for heading in headings)
    assert [heading for heading in headings if "<" in re.sub(r"`[^`]*`", "", heading)] == []
