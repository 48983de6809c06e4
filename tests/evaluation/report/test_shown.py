"""What the page shows: captions in plain words, and figures as large as their letters ask."""

from __future__ import annotations

import base64
import re
import struct

import pytest
from captions import CAPTIONS

from expertaug import plotting
from expertaug.errors import InputError
from expertaug.evaluation.report.shown import PNG, Picture, caption
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


def test_a_picture_holds_its_file_and_is_as_large_as_its_letters_ask():
    content = PNG + b"\0\0\0\rIHDR" + struct.pack(">II", 2 * plotting.DPI, plotting.DPI)
    picture = Picture.of(content)
    kind, _, held = picture.uri.partition(",")
    assert kind == "data:image/png;base64" and base64.b64decode(held) == content
    assert (picture.width, picture.height) == (260, 130), "130 px an inch"
    with pytest.raises(InputError, match=r"x\.png: is no PNG file"):
        Picture.of(b"%PDF" + content, "x.png")
