"""Figures and tables that the page shows, each with its caption: the text that the workflow's rule names for it."""

from __future__ import annotations

import base64
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import jinja2

from expertaug import plotting
from expertaug.errors import InputError
from expertaug.files import check_inside

PNG = b"\x89PNG\r\n\x1a\n"
SCALE = 130 / plotting.DPI  # of pixels on the page to those of a figure: its letters are as large as the text's


@dataclass(frozen=True)
class Shown:
    """A file of the results that is shown.

    Attributes:
        path: in the results folder, ``figures/….png``, or ``….md`` of a table, whose numbers are in the CSV beside it.
        caption: path of its text, a template in the words of Snakemake's reports.
        wildcards: of the file's name, as the rule has them.
        title: a few words.
    """

    path: str
    caption: str
    wildcards: Mapping[str, str]
    title: str

    @property
    def experiment(self) -> str | None:
        """The experiment that it is of; None for what is of all or of recordings."""
        return self.wildcards.get("experiment")

    @property
    def is_figure(self) -> bool:
        return self.path.endswith(".png")

    @property
    def stem(self) -> str:
        """The file's name without its end."""
        return Path(self.path).stem

    def text(self, preset: str) -> str:
        """The caption.

        Raises:
            InputError: its file is missing, or names what it is not given.
        """
        words = SimpleNamespace(wildcards=SimpleNamespace(**self.wildcards), config={"preset": preset})
        try:
            source = Path(self.caption).read_text(encoding="utf-8")
            content = jinja2.Template(source, undefined=jinja2.StrictUndefined).render(snakemake=words)
        except (OSError, jinja2.TemplateError) as error:
            raise InputError(
                self.caption, f"no caption for {self.path} ({error})", "give the workflow's own"
            ) from error
        return " ".join(content.split())

    @property
    def csv(self) -> str:
        """The file of a table's numbers, in the results folder."""
        return str(Path(self.path).with_suffix(".csv"))

    def is_note(self, results: Path) -> bool:
        """Whether the figure says only why there is nothing to draw (:func:`expertaug.plotting.note`)."""
        path = check_inside(Path(results) / self.path, results)
        return path.is_file() and f"Comment\0{plotting.NOTE}".encode() in path.read_bytes()[:4096]

    def picture(self, results: Path) -> tuple[str, int, int]:
        """The figure as a data URI, and its width and height on the page in px.

        Raises:
            InputError: it is missing, or no PNG.
        """
        path = check_inside(Path(results) / self.path, results)
        if not path.is_file():
            raise InputError(path, "no such file", "run the workflow to its end first")
        content = path.read_bytes()
        if content[:8] != PNG or len(content) < 24:
            raise InputError(path, "is no PNG file", "delete it and run the workflow")
        size = (round(pixels * SCALE) for pixels in struct.unpack(">II", content[16:24]))
        return (f"data:image/png;base64,{base64.b64encode(content).decode('ascii')}", *size)
