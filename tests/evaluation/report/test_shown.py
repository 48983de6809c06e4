"""What the page shows: captions in plain words, and figures as large as their letters ask."""

from __future__ import annotations

import re

import pytest
from captions import CAPTIONS

from expertaug.errors import InputError
from expertaug.evaluation.report.shown import caption
from expertaug.evaluation.settings import ShownFile


@pytest.mark.parametrize("path", sorted(CAPTIONS.glob("*.rst")), ids=lambda path: path.name)
def test_captions_are_plain_sentences(path):
    wildcards = {"experiment": "swing", "recording": "r0"}
    text = caption(ShownFile(path="figures/x.png", caption=str(path), wildcards=wildcards, title="x"), "corrected")
    assert text.endswith(".") and not re.search(r"[`*{}]|::|\.\. |None", text), "shown as they are, not as markup"


def test_a_caption_that_names_what_it_is_not_given_is_refused(tmp_path):
    (tmp_path / "c.rst").write_text("{{ snakemake.wildcards.recording }}")
    with pytest.raises(InputError, match=r"no caption for figures/x\.png"):
        caption(ShownFile(path="figures/x.png", caption=str(tmp_path / "c.rst"), wildcards={}, title="x"), "")
