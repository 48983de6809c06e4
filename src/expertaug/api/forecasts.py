"""Forecasts as users get them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
from torch import Tensor

from expertaug.api.arguments import Array
from expertaug.errors import InputError
from expertaug.models.doubts import FitDoubts
from expertaug.trajectories import brief


@dataclass(frozen=True, eq=False)
class Forecast:
    """Forecasts of N windows; of a group of S seeds every array has a leading axis (S,); :meth:`median` has none.

    Attributes:
        t: times in s, (T,).
        y: states (N, T, *state).
        z_e: estimates of the expert parameters by name, (N,) each; empty for a model that estimates none.
        units: unit of every state component and, as ``z_e name``, expert parameter.
        seeds: S of them.
        z_e_std: standard deviations of the estimates by name, where the model has them: a hybrid-VAE's posterior, a
            flow's draws, or Laplace's approximation after refinement.
        chi2: χ² per degree of freedom of each observed window after refinement, (N,); far above 1, the model does not
            explain the window.  None without refinement.
        misfit: mean squared error over the observed window after its first point, summed over the observed quantities,
            (N,); None where a forecast begins at its end.
        p_chi2: probability of a χ² as large as that if the model and the noise are right, (N,); None where no noise is
            known.
        outside: whether the window's z_e or z_a lies outside the range of the training windows', where nothing has
            tested the model, (N,), bool; None where that is not known.
        trusted: whether the misfit is no larger than that of 95 % of the validation windows, and the window not
            outside, (N,), bool; where windows are fitted (of systems without known inputs), whether the error to be
            expected of the forecast is no larger (:mod:`expertaug.inference.expected_error`), and the misfit than that
            of 99 %.  None where these are not known.
        doubts: what is doubtful about the fits of the windows (:class:`expertaug.models.doubts.FitDoubts`, with the
            axis of seeds in any case); None where windows are not fitted.
        y_std: of a median, standard deviations of the states over the seeds, (N, T, *state); else None.
        failed: those of the seeds that could not be trained.
    """

    t: np.ndarray
    y: Array
    z_e: dict[str, Array]
    units: dict[str, str]
    seeds: list[int]
    z_e_std: dict[str, Array] = field(default_factory=dict)
    chi2: Array | None = None
    misfit: Array | None = None
    p_chi2: Array | None = None
    outside: Array | None = None
    trusted: Array | None = None
    doubts: FitDoubts | None = None
    y_std: np.ndarray | None = None
    failed: list[int] = field(default_factory=list)

    def __repr__(self) -> str:
        """In one line, whatever the size."""
        several = len(self.seeds) > 1 and self.y_std is None
        windows = self.y.shape[int(next((values.ndim > 1 for values in self.z_e.values()), several))]
        seeds = f"seeds {self.seeds}" if len(self.seeds) > 1 else f"seed {self.seeds[0]}"
        estimates = f", estimates of {', '.join(self.z_e)}" if self.z_e else ""
        trusted = "" if self.trusted is None else f", {100 * _numpy(self.trusted).mean():.3g} % trusted"
        return f"Forecast({windows} windows, {brief(self.t)}, {seeds}{estimates}{trusted})"

    def median(self) -> Forecast:
        """One forecast of several seeds, which no single seed that fails moves far: at each time, and of each estimate,
        the median over the seeds that could be trained; standard deviations contain the spread over these.  It is
        trusted where all of them are, and lies outside, or is doubtful, where half of them do.  Of one seed it is its
        own.
        """
        if len(self.seeds) < 2 or self.y_std is not None:
            return self
        places = [place for place, seed in enumerate(self.seeds) if seed not in self.failed]

        def of(value: Array) -> np.ndarray:
            return _numpy(value)[places]

        def deviation(values: np.ndarray) -> np.ndarray:
            return np.std(values, 0, ddof=1) if len(places) > 1 else np.full(values.shape[1:], np.nan)

        y, z_e = of(self.y), {name: of(values) for name, values in self.z_e.items()}
        middles = {
            name: np.median(of(value), 0)
            for name in ("chi2", "misfit", "p_chi2")
            if (value := getattr(self, name)) is not None
        }
        return replace(
            self,
            y=np.median(y, 0),
            y_std=deviation(y),
            z_e={name: np.median(values, 0) for name, values in z_e.items()},
            z_e_std={
                name: np.sqrt((of(std) ** 2).mean(0) + np.nan_to_num(deviation(z_e[name])) ** 2)
                for name, std in self.z_e_std.items()
            },
            **middles,
            outside=None if self.outside is None else of(self.outside).mean(0) >= 0.5,
            trusted=None if self.trusted is None else of(self.trusted).astype(bool).all(0),
            doubts=None if self.doubts is None else self.doubts.of_most(places),
        )

    def table(self) -> pd.DataFrame:
        """A row per seed, sample and time; columns seed, sample, ``t [s]``, states, z_e with their units, and, where
        there are any, their standard deviations, χ², misfit, whether the window lies outside, whether to trust it, and
        whether its fit is doubtful.  Of a median no seed, and the states' standard deviations.

        Raises:
            InputError: the state is a field.
        """
        y = _numpy(self.y)
        names = [name for name in self.units if not name.startswith("z_e ")]
        shape = (1 if self.y_std is not None else len(self.seeds), -1, len(self.t), len(names))
        if y.ndim not in (3, 4) or y.shape[-1] != len(names):
            raise InputError("forecast", f"states of shape {y.shape}", "a table holds states that are no fields")
        y = y.reshape(shape)
        index = np.indices(y.shape[:3]).reshape(3, -1)
        columns = {} if self.y_std is not None else {"seed": np.array(self.seeds)[index[0]]}
        columns |= {"sample": index[1], "t [s]": self.t[index[2]]}
        for k, name in enumerate(names):
            columns[label_column(name, self.units[name])] = y[..., k].ravel()
            if self.y_std is not None:
                columns[label_column(f"{name} std", self.units[name])] = self.y_std[..., k].ravel()
        of_window = {label_column(f"z_e {name}", self.units[f"z_e {name}"]): value for name, value in self.z_e.items()}
        of_window |= {
            label_column(f"z_e {name} std", self.units[f"z_e {name}"]): value for name, value in self.z_e_std.items()
        }
        further = ("chi2", "p_chi2", "misfit", "outside", "trusted")
        of_window |= {name: value for name in further if (value := getattr(self, name)) is not None}
        if self.doubts is not None:
            of_window["doubtful"] = self.doubts.any
        for name, value in of_window.items():
            each = _numpy(value).reshape(y.shape[:2])
            columns[name] = each[index[0], index[1]]
        return pd.DataFrame(columns)


def _numpy(value: Array) -> np.ndarray:
    return np.asarray(value.cpu() if isinstance(value, Tensor) else value)


def label_column(name: str, unit: str) -> str:
    """Heading of a column."""
    return f"{name} [{unit}]" if unit else name
