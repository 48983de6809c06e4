"""Which hue a method has: the same in every figure of a configuration."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence

# Hues that the colour-blind tell apart (Okabe and Ito, with a grey, a brown and an olive).
HUES = ("#7A7A7A", "#E69F00", "#009E73", "#56B4E9", "#8C5A2B", "#0072B2", "#D55E00", "#B5589A", "#999933")


def assigned(figures: Iterable[Sequence[str]], hues: Mapping[str, int] | None = None) -> dict[str, int]:
    """An index of :data:`HUES` for each method, which differ within a figure as long as there are as many hues.

    Arguments:
        figures: the methods that may be drawn together, of each figure; the first to come has the first hue.
        hues: that methods have already.
    """
    found, beside = dict(hues or {}), defaultdict(list)
    figures = list(map(list, figures))
    for methods in figures:
        for method in methods:
            beside[method] += methods
    for method in dict.fromkeys(method for methods in figures for method in methods):
        if method not in found:
            taken = Counter(found[other] for other in dict.fromkeys(beside[method]) if other in found)
            own = len(found) % len(HUES)
            found[method] = min(range(own, own + len(HUES)), key=lambda hue: taken[hue % len(HUES)]) % len(HUES)
    return found
