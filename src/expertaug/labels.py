"""Names of a method's versions.

``method`` is the method as trained, ``method+`` its augmented version, ``method+name`` the version augmented with the
experiment's prior called ``name``; they are printed as ``Label``, ``Label+`` and ``Label+ (name)``.  A method may be a
point of a grid: ``method@3``, printed as ``Label @3``.
"""

from __future__ import annotations

import re

_PLUS = re.compile(r"\+( \([^()]*\))?$")


def split(variant: str) -> tuple[str, str | None]:
    """The method and the name of its prior: None as trained, empty for the experiment's own prior."""
    method, plus, name = variant.partition("+")
    return method, name if plus else None


def label(base: str, variant: str) -> str:
    """What is printed for a version of the method that is printed as ``base``."""
    name = split(variant)[1]
    if name is None:
        return base
    return f"{base}+ ({name})" if name else f"{base}+"


def is_augmented(printed: str) -> bool:
    """Whether a printed label is an augmented version's."""
    return _PLUS.search(printed) is not None


def base_label(printed: str) -> str:
    """A printed label without the +; what stands behind in brackets stays."""
    return _PLUS.sub(r"\1", printed)
