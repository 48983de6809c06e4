"""Names of sets and of a method's versions.

One grammar names every version in files, tables and MLflow:

    METHOD [ "=" | "+" [PRIOR] ] { "~" ESTIMATOR }

``method`` is the method as trained; ``method+`` its augmented version, ``method+name`` the version augmented with the
experiment's prior called ``name``; ``method=`` its control, trained on for the same steps on the real data alone.
``~flow`` is the posterior that a flow learned from draws of the version's decoder, ``~refined`` the version whose
estimates are refined by least squares on each window.  They are printed as ``Label``, ``Label+``, ``Label+ (name)``,
``Label (control)``, ``Label+ flow``, ``Label+ flow, refined``.  A method may be a point of a grid: ``method@3``,
printed as ``Label @3``.  What a version is follows from its name alone: a printed label may contain anything.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

LINES = 8  # of one figure that can be told apart
MAIN_SETS = ("train", "validation", "test")  # that every experiment has
# Those that tables and figures show, in order; iid: drawn as validation is, and nothing is chosen on it.
SHOWN_SETS = ("train", "validation", "iid", "test")

AUGMENTED, CONTROL, ESTIMATOR = "+", "=", "~"
FLOW, REFINED = "flow", "refined"  # the estimators


@dataclass(frozen=True)
class Version:
    """What a version's name says.

    Attributes:
        method: of which this is a version.
        step: what followed the training: nothing (""), augmentation ("+") or the control ("=").
        prior: name of the augmentation prior; empty for the experiment's own, None where nothing was augmented.
        estimators: what stands in the encoder's place, in order: flow, refined.
    """

    method: str
    step: str
    prior: str | None
    estimators: tuple[str, ...]


def parse(variant: str) -> Version:
    """The parts of a version's name."""
    trained, *estimators = variant.split(ESTIMATOR)
    if trained.endswith(CONTROL):
        return Version(trained.removesuffix(CONTROL), CONTROL, None, tuple(estimators))
    method, plus, name = trained.partition(AUGMENTED)
    return Version(method, plus, name if plus else None, tuple(estimators))


def split(variant: str) -> tuple[str, str | None]:
    """The method and the name of its prior: None where nothing is augmented, empty for the experiment's own prior."""
    found = parse(variant)
    return found.method, found.prior


def base(variant: str) -> str:
    """The method of which this is a version."""
    return parse(variant).method


def is_augmented(variant: str) -> bool:
    """Whether this is a method's augmented version."""
    return parse(variant).step == AUGMENTED


def is_control(variant: str) -> bool:
    """Whether this is the control of a method's augmented version."""
    return parse(variant).step == CONTROL


def is_flow(variant: str) -> bool:
    """Whether a flow, itself trained, stands in the encoder's place."""
    return FLOW in parse(variant).estimators


def is_refined(variant: str) -> bool:
    """Whether estimates are refined on each window."""
    return REFINED in parse(variant).estimators


def compared(versions: Sequence[str], classical: str | None = None) -> list[str]:
    """The versions that one figure compares, at most LINES.

    First the classical estimator and methods that have flows or refined versions, as trained and augmented, then the
    flows, then other methods as trained; no controls, no refined versions.
    """
    studied = {base(v) for v in versions if is_flow(v) or is_refined(v)}

    def rank(version: str) -> int:
        if is_flow(version):
            return 1
        return 0 if version == classical or base(version) in studied else 2 if not is_augmented(version) else 3

    chosen = sorted((v for v in versions if not is_control(v) and not is_refined(v)), key=rank)[:LINES]
    return [v for v in versions if v in chosen]


def trained(variant: str) -> str:
    """The version whose model file this one uses: refinement is no training."""
    return variant.removesuffix(f"{ESTIMATOR}{REFINED}")


def label(base: str, variant: str) -> str:
    """What is printed for a version of the method that is printed as ``base``."""
    found = parse(variant)
    sign = AUGMENTED if found.step == AUGMENTED else ""
    notes = [found.prior] if found.prior else ["control"] if found.step == CONTROL else []
    printed = f"{base}{sign}" + (f" ({notes[0]})" if notes else "")
    return printed + (f" {', '.join(found.estimators)}" if found.estimators else "")


def paired(variants: Iterable[str]) -> list[str]:
    """The versions of those methods that have an augmented one; all where there is none."""
    known = list(dict.fromkeys(variants))
    bases = {base(variant) for variant in known if is_augmented(variant)}
    return [variant for variant in known if base(variant) in bases] or known


def ordered(variants: Iterable[str], methods: Iterable[str] = ()) -> list[str]:
    """Versions in the order of ``methods``, then of appearance: as trained, controls, then augmented ones."""
    known = list(dict.fromkeys(variants))
    bases = dict.fromkeys(base(variant) for variant in (*methods, *known))
    ranked = sorted(known, key=lambda variant: ("", CONTROL, AUGMENTED).index(parse(variant).step))
    return [variant for one in bases for variant in ranked if base(variant) == one]
