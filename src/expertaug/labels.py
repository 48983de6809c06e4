"""Names of sets and of a method's versions.

``method`` is the method as trained, ``method+`` its augmented version, ``method+name`` the version augmented with the
experiment's prior called ``name``; they are printed as ``Label``, ``Label+`` and ``Label+ (name)``.  A method may be a
point of a grid: ``method@3``, printed as ``Label @3``.  What a version is follows from its name alone: a printed label
may contain anything.
"""

from __future__ import annotations

from collections.abc import Iterable

MAIN_SETS = ("train", "validation", "test")  # that every experiment has


def split(variant: str) -> tuple[str, str | None]:
    """The method and the name of its prior: None as trained, empty for the experiment's own prior."""
    method, plus, name = variant.partition("+")
    return method, name if plus else None


def base(variant: str) -> str:
    """The method of which this is a version."""
    return split(variant)[0]


def is_augmented(variant: str) -> bool:
    """Whether this is a method's augmented version."""
    return split(variant)[1] is not None


def label(base: str, variant: str) -> str:
    """What is printed for a version of the method that is printed as ``base``."""
    name = split(variant)[1]
    if name is None:
        return base
    return f"{base}+ ({name})" if name else f"{base}+"


def paired(variants: Iterable[str]) -> list[str]:
    """The versions of those methods that have an augmented one; all where there is none."""
    known = list(dict.fromkeys(variants))
    bases = {base(variant) for variant in known if is_augmented(variant)}
    return [variant for variant in known if base(variant) in bases] or known


def ordered(variants: Iterable[str], methods: Iterable[str] = ()) -> list[str]:
    """Versions in the order of ``methods``, then of appearance, each augmented one behind the method as trained."""
    known = list(dict.fromkeys(variants))
    bases = dict.fromkeys(base(variant) for variant in (*methods, *known))
    return [variant for one in bases for variant in sorted(known, key=is_augmented) if base(variant) == one]
