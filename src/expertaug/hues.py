"""Which hue a method has: the same in every figure of a configuration."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence

# Those of Okabe and Ito with a grey, a brown and an olive, moved until the colour-blind see each pair as two, light and
# dark.
HUES = ("#686868", "#F6AD00", "#04B55F", "#51D0DD", "#894F0F", "#006EC3", "#ED5202", "#A3489A", "#9EAF47")
FLOOR = len(HUES)  # index of the true equation's colour, which is nobody else's
EQUATION = "#2A2A2A"
# The methods of the default configuration keep theirs in every other; those of one hue are seldom in one figure.
OWN = {
    "mean": 0,
    "expert_only": 1,
    "least_squares": 2,
    "truth": FLOOR,
    "ml_only": 4,
    "aphynity": 5,
    "hvae": 6,
    "alternating": 7,
    "least_squares_friction": 8,
    "expert_only_point_mass": 3,
    "aphynity_point_mass": 3,
    "hvae_point_mass": 1,
    "aphynity_of_z_e": 3,
    "aphynity_diffusion": 3,
    "aphynity_damping": 8,
    "aphynity_polynomial": 8,
    "hvae_polynomial": 4,
    "least_squares_shared": 8,
    "alternating_shared": 3,
    "aphynity_shared": 1,
    "hvae_shared": 4,
}


def assign_hues(figures: Iterable[Sequence[str]], hues: Mapping[str, int] | None = None) -> dict[str, int]:
    """An index of :data:`HUES` for each method, which differ within a figure as long as there are as many hues.

    Arguments:
        figures: the methods that may be drawn together, of each figure; the first to come has the first hue.
        hues: that methods have already.
    """
    hue_of, beside = dict(hues or {}), defaultdict(list)
    figures = list(map(list, figures))
    for methods in figures:
        for method in methods:
            beside[method] += methods
    for method in dict.fromkeys(method for methods in figures for method in methods):
        if method not in hue_of:
            taken = Counter(hue_of[other] for other in dict.fromkeys(beside[method]) if other in hue_of)
            own = len(hue_of) % len(HUES)
            hue_of[method] = min(range(own, own + len(HUES)), key=lambda hue: taken[hue % len(HUES)]) % len(HUES)
    return hue_of
