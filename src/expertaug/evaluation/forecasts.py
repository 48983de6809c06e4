"""What the stage evaluate keeps of a version's forecasts: one value, and the forecasts.npz that holds it.

The file's arrays are the fields of :class:`Forecasts` and, as ``<set>_<field>``, those of :class:`SetForecasts` and
:class:`KeptForecasts`; what is None has no array.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from expertaug.errors import InputError
from expertaug.files import atomic, read_npz
from expertaug.models.fit_settings import POWERS, Population, Refinement

REMEDY = "make it again with evaluate"
OWN = "own"  # the set of windows that the version's models have made themselves
TEXTS = ("state_names", "state_units", "parameter_names", "parameter_units")
MORE_TEXTS = ("interaction_names", "estimated_names", "estimated_units", "positive_names")
CONSTANTS = "constants_"  # arrays of what the model's file says of windows together, by field
CONSTANT_TYPES = (str, str, str, float, float, float, int, int)
SHARED = "all windows (shared)"
POPULATIONS = {"window": "windows (population)", "trajectory": "trajectories (population)"}
ALWAYS = ("t", "observed", "seeds", *TEXTS)
OF_A_SET = ("errors", "misfit", "truth", "z_e")  # a set is what has one of these


class VersionKey(NamedTuple):
    """What tells one file from another, but for its seeds."""

    experiment: str
    preset: str
    method: str


class ConstantEstimate(NamedTuple):
    """What the file of a version's model says of windows together, beside the parameters that all of them share.

    Attributes:
        name: of the parameter, or of a sensor's constant as tables print it.
        unit: of the constant; empty of a scale.
        of: all windows, a trajectory's name, or whose distribution it is the middle of.
        value, error: and its standard error.
        spread: standard deviation of a distribution, in the same unit; else NaN.
        windows: of a trajectory; 0: all.
        groups: number of independent groups of windows that it is from; 1 where the error is by what they state.
    """

    name: str
    unit: str
    of: str
    value: float
    error: float
    spread: float
    windows: int
    groups: int

    @property
    def of_population(self) -> bool:
        """Whether it is the middle of a distribution."""
        return self.of in POPULATIONS.values()


def constants_of(
    refinement: Refinement | None, parameters: Mapping[str, str], state: Mapping[str, str]
) -> list[ConstantEstimate]:
    """What a version's windows are fitted with.

    Arguments:
        parameters, state: unit of each expert parameter and of each component of the state, by name.
    """
    constants: list[ConstantEstimate] = []
    if refinement is None:
        return constants
    for name, fitted in (refinement.population or {}).items():
        of, numbers = (
            POPULATIONS[fitted.unit],
            (fitted.middle.value, fitted.middle.error, _deviation(fitted), 0, fitted.middle.groups),
        )
        constants.append(ConstantEstimate(name, parameters[name], of, *numbers))
    for name, each in (refinement.trajectories or {}).items():
        for of, fitted in each.items():
            numbers = fitted.value, fitted.error, math.nan, fitted.groups, 1
            constants.append(ConstantEstimate(name, parameters[name], of, *numbers))
    for component, sensor in (refinement.sensors or {}).items():
        for name in sensor.known:
            fitted, unit = getattr(sensor, name), _power(state[component], POWERS[name])
            numbers = fitted.value, fitted.error, math.nan, 0, fitted.groups
            constants.append(ConstantEstimate(f"{name} of {component}", unit, SHARED, *numbers))
    return constants


def _power(unit: str, power: int) -> str:
    """A unit to the power 1, 0, −1 or −2."""
    if not unit or power >= 0:
        return unit * power
    return f"1/{unit if unit.isalpha() else f'({unit})'}{-power if power < -1 else ''}"


def _deviation(population: Population) -> float:
    """Standard deviation of a distribution, in the parameter's unit; of a wide lognormal one it is well above its
    median times that of the logarithm."""
    if population.form == "normal":
        return population.spread.value
    square = population.spread.value**2
    return population.middle.value * math.exp(square / 2) * math.sqrt(math.expm1(square))


@dataclass(frozen=True)
class KeptForecasts:
    """Forecasts of K chosen samples of a set.

    Attributes:
        index: which samples, (K,).
        truth: their states, (K, T, *state).
        prediction: their forecasts, (S, K, T, *state).
        band: ends of the 90 % band of forecasts from draws, (2, S, K, T', *state), over the last T' times; None of a
            version without a distribution.
        id: where they come from, (K,) texts (:class:`expertaug.trajectories.Trajectories`); None where nobody knows.
    """

    index: np.ndarray
    truth: np.ndarray
    prediction: np.ndarray
    band: np.ndarray | None = None
    id: np.ndarray | None = None


@dataclass(frozen=True)
class SetForecasts:
    """What is kept of every sample of a set, of S seeds and N samples.

    Attributes:
        errors: squared error of each forecast, (S, N); NaN of seeds that failed, and where nothing was measured.
        misfit: the same over the observed window after its first point, (S, N).
        z_e: true expert parameters, (N, P); of the set :data:`OWN` each seed's own are nowhere kept.
        z_a: true parameters of the interaction, (N, Q), where they are known.
        z_e_hat: estimates, (S, N, P), of a version that estimates; not of the training set.
        sample_id: where the samples come from, (N,) texts.
        estimated, estimated_std: estimates of what :attr:`Forecasts.estimated_names` names, (S, N, K), of the training
            set too, and their standard deviations, where the version states some.
        expected: squared error that is expected of each forecast, (S, N), by a version with a distribution.
        moved: the same that a refined version expects of its encoder's forecasts.
        median: squared error of the median over the seeds' forecasts, (N,), of several seeds that could be trained.
        ranks, tarp: of the true parameters among draws of z_e, (S, N, P), and by distance from random points, (S, N).
        crps, inside: of the drawn forecasts of M windows, (S, M), and the share of each one's times and quantities
            within its central intervals, (S, M, L).
        kept: forecasts of chosen samples.
    """

    errors: np.ndarray | None = None
    misfit: np.ndarray | None = None
    z_e: np.ndarray | None = None
    z_a: np.ndarray | None = None
    z_e_hat: np.ndarray | None = None
    sample_id: np.ndarray | None = None
    estimated: np.ndarray | None = None
    estimated_std: np.ndarray | None = None
    expected: np.ndarray | None = None
    moved: np.ndarray | None = None
    median: np.ndarray | None = None
    ranks: np.ndarray | None = None
    tarp: np.ndarray | None = None
    crps: np.ndarray | None = None
    inside: np.ndarray | None = None
    kept: KeptForecasts | None = None

    def arrays(self, name: str) -> dict[str, np.ndarray]:
        """By their names in the file."""
        values = {**vars(self), **({} if self.kept is None else vars(self.kept))}
        return {f"{name}_{key}": value for key, value in values.items() if key != "kept" and value is not None}


@dataclass(frozen=True)
class Forecasts:
    """Errors and estimates of all samples, and forecasts of chosen ones, by S seeds of a version.

    Attributes:
        t: times in s, (T,).
        observed: index of the last observed point.
        seeds: (S,).
        state_names, state_units, parameter_names, parameter_units: texts, one per dimension.
        sets: by name.
        failed: seeds that could not be trained.
        interaction_names: of the true interaction's parameters, where they are known.
        estimated_names, estimated_units: of the expert parameters and, where the equation is the true one, of the
            interaction's.
        positive_names: of those that cannot be negative.
        shared: of those that all windows share, the number of independent groups of windows that they are from.
        constants: what the model's file says of windows together, beside these.
        version: whose they are; None of a file from before that was kept, and in memory.
        rank_draws: K, the number of draws among which ``ranks`` of the sets are.
        own: ranks and scores on windows that the version's models have made themselves.
        path: of the file.
    """

    t: np.ndarray
    observed: int
    seeds: list[int]
    state_names: list[str]
    state_units: list[str]
    parameter_names: list[str]
    parameter_units: list[str]
    sets: dict[str, SetForecasts]
    failed: list[int] = field(default_factory=list)
    interaction_names: list[str] = field(default_factory=list)
    estimated_names: list[str] = field(default_factory=list)
    estimated_units: list[str] = field(default_factory=list)
    positive_names: list[str] = field(default_factory=list)
    shared: Mapping[str, int] = field(default_factory=dict)
    constants: Sequence[ConstantEstimate] = ()
    version: VersionKey | None = None
    rank_draws: int | None = None
    own: SetForecasts | None = None
    path: Path | None = field(default=None, compare=False)

    @property
    def places(self) -> list[int]:
        """Places of the seeds that could be trained."""
        return [place for place, seed in enumerate(self.seeds) if seed not in self.failed]

    @property
    def kept(self) -> dict[str, KeptForecasts]:
        """Forecasts of chosen samples, of the sets that have some."""
        return {name: set_forecasts.kept for name, set_forecasts in self.sets.items() if set_forecasts.kept is not None}

    @property
    def truths(self) -> dict[str, np.ndarray]:
        """True expert parameters, (N, P), of the sets that have some."""
        return {name: set_forecasts.z_e for name, set_forecasts in self.sets.items() if set_forecasts.z_e is not None}

    @property
    def estimates(self) -> dict[str, np.ndarray]:
        """Estimates, (S, N, P), of the sets that figures show: those of which forecasts are kept, if any are."""
        shown = self.kept or self.sets
        return {name: self.sets[name].z_e_hat for name in shown if self.sets[name].z_e_hat is not None}

    def identified(self) -> VersionKey:
        """Whose they are.

        Raises:
            InputError: the file does not say.
        """
        if self.version is None:
            raise InputError(self.path or "forecasts", "no array 'version'", REMEDY)
        return self.version

    def save(self, path: str | Path) -> None:
        """Write the file."""
        arrays: dict[str, Any] = {}
        for name, set_forecasts in self.sets.items():
            arrays |= set_forecasts.arrays(name)
        arrays |= {} if self.own is None else self.own.arrays(OWN)
        arrays |= {name: getattr(self, name) for name in ("t", "observed", "seeds", "rank_draws", "version")}
        texts = {name: np.array(getattr(self, name), dtype=str) for name in (*TEXTS, *MORE_TEXTS)}
        texts["shared_names"] = np.array(list(self.shared), dtype=str)
        arrays["shared_groups"] = np.array(list(self.shared.values()), dtype=int)
        for name, values in zip(ConstantEstimate._fields, zip(*self.constants, strict=True), strict=False):
            arrays[CONSTANTS + name] = np.array(values)
        stored = {key: np.array(value) for key, value in arrays.items() if value is not None}
        with atomic(path) as temporary, temporary.open("wb") as stream:
            np.savez_compressed(stream, **stored, failed=np.array(self.failed, dtype=int), **texts)

    @classmethod
    def load(cls, path: str | Path) -> Forecasts:
        """Read the file.

        Raises:
            InputError: the file is missing, is no npz, lacks an array, or shapes disagree.
        """
        arrays = read_npz(path, "forecast file", REMEDY)
        try:
            return cls._of(Path(path), arrays)
        except (TypeError, ValueError, IndexError) as error:
            raise InputError(path, f"not a forecast file ({error})", REMEDY) from error

    @classmethod
    def _of(cls, path: Path, arrays: Mapping[str, np.ndarray]) -> Forecasts:
        if missing := [name for name in ALWAYS if name not in arrays]:
            raise InputError(path, f"no array {missing[0]!r}", REMEDY)
        ends = [(name, end) for name in arrays for end in OF_A_SET if name.endswith(f"_{end}")]
        sets = dict.fromkeys(name.removesuffix(f"_{end}") for name, end in ends)
        own = _pick(SetForecasts, OWN, arrays)
        return cls(
            t=arrays["t"],
            observed=int(arrays["observed"]),
            seeds=[int(seed) for seed in arrays["seeds"]],
            **{name: [str(text) for text in arrays[name]] for name in TEXTS},
            sets={name: _of_set(path, name, arrays) for name in sets},
            failed=[int(seed) for seed in arrays.get("failed", ())],
            **{name: [str(text) for text in arrays.get(name, ())] for name in MORE_TEXTS},
            shared={
                str(name): int(groups)
                for name, groups in zip(arrays.get("shared_names", ()), arrays.get("shared_groups", ()), strict=True)
            },
            constants=[
                ConstantEstimate(*(kind(value) for kind, value in zip(CONSTANT_TYPES, row, strict=True)))
                for row in zip(*(arrays.get(CONSTANTS + name, ()) for name in ConstantEstimate._fields), strict=True)
            ],
            version=VersionKey(*map(str, arrays["version"])) if "version" in arrays else None,
            rank_draws=int(arrays["rank_draws"]) if "rank_draws" in arrays else None,
            own=SetForecasts(**own) if own else None,
            path=path,
        )


def read_forecasts(paths: Iterable[str | Path]) -> list[Forecasts]:
    """Several files, as of all versions and groups of seeds of an experiment.

    Raises:
        InputError: a file is broken.
    """
    return [Forecasts.load(path) for path in paths]


def _of_set(path: Path, name: str, arrays: Mapping[str, np.ndarray]) -> SetForecasts:
    kept = None
    if f"{name}_truth" in arrays:
        if missing := [end for end in ("index", "prediction", "z_e") if f"{name}_{end}" not in arrays]:
            raise InputError(path, f"no array '{name}_{missing[0]}'", REMEDY)
        kept = KeptForecasts(**_pick(KeptForecasts, name, arrays))
        _check_kept(path, name, kept, (len(arrays["seeds"]), len(kept.index), len(arrays["t"])))
    return SetForecasts(**_pick(SetForecasts, name, arrays), kept=kept)


def _pick(kind: type, name: str, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """A set's arrays that are fields of a class."""
    by_field = {attribute.name: arrays.get(f"{name}_{attribute.name}") for attribute in fields(kind)}
    return {key: value for key, value in by_field.items() if value is not None}


def _check_kept(path: Path, name: str, kept: KeptForecasts, size: tuple[int, int, int]) -> None:
    """Refuse shapes that are not those of S seeds, K samples and T times."""
    shape = (*size, *kept.truth.shape[2:])
    right = f"forecasts are (S, K, T, *state), here {shape}"
    if kept.prediction.shape != shape or kept.truth.shape != shape[1:]:
        wrong = f"{name}_truth {kept.truth.shape} and {name}_prediction {kept.prediction.shape}"
        raise InputError(path, wrong, right)
    band = kept.band
    if band is not None and (band.shape[1:3] != shape[:2] or band.shape[4:] != shape[3:]):
        raise InputError(path, f"{name}_band {band.shape}", right)
    if kept.id is not None and (kept.id.shape != shape[1:2] or kept.id.dtype.kind != "U"):
        wrong = f"{name}_id {kept.id.shape} of type {kept.id.dtype}"
        raise InputError(path, wrong, f"identities are ({shape[1]},), texts")
