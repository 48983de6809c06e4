"""The forecasts.npz of the stage evaluate, read and checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from expertaug import plotting
from expertaug.errors import InputError
from expertaug.files import read_npz

ALWAYS = ("t", "observed", "seeds", "state_names", "state_units", "parameter_names", "parameter_units")


@dataclass(frozen=True)
class Forecasts:
    """Forecasts of chosen samples and parameters of all samples, of S seeds.

    Attributes:
        t: times in s, (T,).
        observed: index of the last observed point.
        seeds: (S,).
        failed: those of them that could not be trained.
        state_names, state_units, parameter_names, parameter_units: texts, one per dimension.
        index, truth, prediction: by set: which samples, (K,); their states, (K, T, *state), and forecasts,
            (S, K, T, *state).
        truths, estimates: by set: expert parameters, (N, P), and their estimates, (S, N, P); the second is empty for a
            method that estimates none. The training set may be in the first alone.
        band: by set: ends of the 90 % band of the chosen samples' forecasts, (2, S, K, T', *state), over the last T'
            times; empty for a method without a distribution.
        id: by set: where the chosen samples come from, (K,) texts (:class:`expertaug.trajectories.Trajectories`); empty
            where that is not known.
    """

    t: np.ndarray
    observed: int
    seeds: list[int]
    state_names: list[str]
    state_units: list[str]
    parameter_names: list[str]
    parameter_units: list[str]
    index: dict[str, np.ndarray]
    truth: dict[str, np.ndarray]
    prediction: dict[str, np.ndarray]
    truths: dict[str, np.ndarray]
    estimates: dict[str, np.ndarray]
    id: dict[str, np.ndarray] = field(default_factory=dict)
    band: dict[str, np.ndarray] = field(default_factory=dict)
    failed: list[int] = field(default_factory=list)

    @property
    def places(self) -> list[int]:
        """Places of the seeds that could be trained."""
        return [place for place, seed in enumerate(self.seeds) if seed not in self.failed]

    def parameters(self, name: str, sample: int) -> list[str]:
        """The expert parameters of a kept sample of a set, as figures print them."""
        values = self.truths[name][self.index[name][sample]]
        described = zip(self.parameter_names, self.parameter_units, values, strict=True)
        return [
            f"{plotting.symbol(p)} = {value:.3g} {unit}".strip().replace("-", "−")
            for p, unit, value in described
            if np.isfinite(value)
        ]

    @classmethod
    def load(cls, path: str | Path) -> Forecasts:
        """Read the file.

        Raises:
            InputError: the file is missing, is no npz, lacks an array, or shapes disagree.
        """
        arrays = read_npz(path, "forecast file", "make it again with evaluate")
        try:
            return cls._of(path, arrays)
        except (TypeError, ValueError, IndexError) as error:
            raise InputError(path, f"not a forecast file ({error})", "make it again with evaluate") from error

    @classmethod
    def _of(cls, path: str | Path, arrays: Mapping[str, np.ndarray]) -> Forecasts:
        sets = [name.removesuffix("_truth") for name in arrays if name.endswith("_truth")]
        wanted = [*ALWAYS, *(f"{s}_{end}" for s in sets for end in ("index", "prediction", "z_e"))]
        if missing := [name for name in wanted if name not in arrays]:
            raise InputError(path, f"no array {missing[0]!r}", "make it again with evaluate")
        for name in sets:
            truth, prediction = arrays[f"{name}_truth"], arrays[f"{name}_prediction"]
            expected = (len(arrays["seeds"]), len(arrays[f"{name}_index"]), len(arrays["t"]), *truth.shape[2:])
            if prediction.shape != expected or truth.shape != expected[1:]:
                found = f"{name}_truth {truth.shape} and {name}_prediction {prediction.shape}"
                raise InputError(path, found, f"forecasts are (S, K, T, *state), here {expected}")
            band = arrays.get(f"{name}_band")
            if band is not None and (band.shape[1:3] != expected[:2] or band.shape[4:] != expected[3:]):
                raise InputError(path, f"{name}_band {band.shape}", f"forecasts are (S, K, T, *state), here {expected}")
            identity = arrays.get(f"{name}_id")
            if identity is not None and (identity.shape != expected[1:2] or identity.dtype.kind != "U"):
                found = f"{name}_id {identity.shape} of type {identity.dtype}"
                raise InputError(path, found, f"identities are ({expected[1]},), texts")
        return cls(
            t=arrays["t"],
            observed=int(arrays["observed"]),
            seeds=[int(seed) for seed in arrays["seeds"]],
            **{name: [str(text) for text in arrays[name]] for name in ALWAYS[3:]},
            **{name: {s: arrays[f"{s}_{name}"] for s in sets} for name in ("index", "truth", "prediction")},
            truths={name.removesuffix("_z_e"): arrays[name] for name in arrays if name.endswith("_z_e")},
            estimates={s: arrays[f"{s}_z_e_hat"] for s in sets if f"{s}_z_e_hat" in arrays},
            failed=[int(seed) for seed in arrays.get("failed", ())],
            band={s: arrays[f"{s}_band"] for s in sets if f"{s}_band" in arrays},
            id={s: arrays[f"{s}_id"] for s in sets if f"{s}_id" in arrays},
        )
