"""Versions of a method, and names of sets.

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
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

from pydantic_core import core_schema

LINES = 7  # of one panel, at most
MAIN_SETS = ("train", "validation", "test")  # that every experiment has
# Those that tables and figures show, in order; iid: drawn as validation is, and nothing is chosen on it.
SHOWN_SETS = ("train", "validation", "iid", "test")

AUGMENTED, CONTROL, ESTIMATOR = "+", "=", "~"
FLOW, REFINED = "flow", "refined"  # the estimators


@dataclass(frozen=True)
class Version:
    """A version of a method; ``str`` gives its name.

    Attributes:
        method: of which this is a version.
        step: what followed the training: nothing (""), augmentation ("+") or the control ("=").
        prior: name of the augmentation prior; empty for the experiment's own, None where nothing was augmented.
        estimators: what stands in the encoder's place, in order: flow, refined.
    """

    method: str
    step: str = ""
    prior: str | None = None
    estimators: tuple[str, ...] = ()

    @staticmethod
    def parse(name: str) -> Version:
        """The version of this name."""
        return _parse(name)

    def __str__(self) -> str:
        return ESTIMATOR.join([f"{self.method}{self.step}{self.prior or ''}", *self.estimators])

    @property
    def is_augmented(self) -> bool:
        """Whether this is a method's augmented version."""
        return self.step == AUGMENTED

    @property
    def is_control(self) -> bool:
        """Whether this is the control of a method's augmented version."""
        return self.step == CONTROL

    @property
    def is_flow(self) -> bool:
        """Whether a flow, itself trained, stands in the encoder's place."""
        return FLOW in self.estimators

    @property
    def is_refined(self) -> bool:
        """Whether estimates are refined on each window."""
        return REFINED in self.estimators

    @property
    def is_trained(self) -> bool:
        """Whether it has a model file of its own."""
        return self.trained == self

    @property
    def trained(self) -> Version:
        """The version whose model file this one uses: refinement is no training."""
        return replace(self, estimators=self.estimators[:-1]) if self.estimators[-1:] == (REFINED,) else self

    def augmented(self, prior: str = "") -> Version:
        """The method's version augmented with a prior; the experiment's own is called by an empty name."""
        return Version(self.method, AUGMENTED, prior)

    def control(self) -> Version:
        """The control of the method's augmented version."""
        return Version(self.method, CONTROL)

    def label(self, method: str) -> str:
        """What is printed, for a method that is printed as ``method``."""
        sign = AUGMENTED if self.is_augmented else ""
        note = self.prior or ("control" if self.is_control else "")
        printed = f"{method}{sign}" + (f" ({note})" if note else "")
        return printed + (f" {', '.join(self.estimators)}" if self.estimators else "")

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> core_schema.CoreSchema:
        """A key of typed settings: its name in JSON."""
        named = core_schema.no_info_after_validator_function(cls.parse, core_schema.str_schema())
        return core_schema.json_or_python_schema(
            named,
            core_schema.union_schema([core_schema.is_instance_schema(cls), named]),
            serialization=core_schema.plain_serializer_function_ser_schema(str),
        )


@cache
def _parse(name: str) -> Version:
    trained, *estimators = name.split(ESTIMATOR)
    if trained.endswith(CONTROL):
        return Version(trained.removesuffix(CONTROL), CONTROL, None, tuple(estimators))
    method, plus, prior = trained.partition(AUGMENTED)
    return Version(method, plus, prior if plus else None, tuple(estimators))


# Of names, as they stand in the column "method" of tables.


def base(name: str) -> str:
    """The method of which this is a version."""
    return Version.parse(name).method


def choose_compared(names: Sequence[str], classical: str | None = None, most: int = LINES) -> list[str]:
    """The versions that one figure compares, at most so many.

    First the classical estimator and methods that have flows or refined versions, as trained and augmented, then the
    flows, then other methods as trained; no controls, no refined versions.
    """
    versions = {name: Version.parse(name) for name in names}
    studied = {v.method for v in versions.values() if v.is_flow or v.is_refined}

    def rank(name: str) -> int:
        version = versions[name]
        if version.is_flow:
            return 1
        return 0 if name == classical or version.method in studied else 2 if not version.is_augmented else 3

    chosen = sorted((n for n, v in versions.items() if not v.is_control and not v.is_refined), key=rank)[:most]
    return [name for name in names if name in chosen]


def choose_paired(names: Iterable[str]) -> list[str]:
    """The versions of those methods that have an augmented one; all where there is none."""
    each = list(dict.fromkeys(names))
    methods = {base(name) for name in each if Version.parse(name).is_augmented}
    return [name for name in each if base(name) in methods] or each


def order_versions(names: Iterable[str], methods: Iterable[str] = ()) -> list[str]:
    """Versions in the order of ``methods``, then of appearance: as trained, controls, then augmented ones."""
    each = list(dict.fromkeys(names))
    ranked = sorted(each, key=lambda name: ("", CONTROL, AUGMENTED).index(Version.parse(name).step))
    return [
        name
        for method in dict.fromkeys(base(name) for name in (*methods, *each))
        for name in ranked
        if base(name) == method
    ]
