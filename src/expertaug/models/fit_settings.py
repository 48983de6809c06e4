"""How windows are fitted, and what such fits have found; no torch is loaded."""

import math
import statistics
from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from expertaug.models.settings import AXES
from expertaug.settings import (
    LEFT_OUT,
    Count,
    Noise,
    NotNegative,
    Positive,
    Prior,
    Range,
    Settings,
    Share,
    disagree,
    key,
)
from expertaug.systems.settings import SolverSettings

# Of the constants of a sensor, the power of its component's unit that each has; a curve's are negative.
POWERS = {"scale": 0, "offset": 1, "quadratic": -1, "cubic": -2}
CURVED = tuple(name for name, power in POWERS.items() if power < 0)


class SensorSettings(Settings):
    """What is estimated of the sensor of a component y of the state.

    It shows offset + scale · (y + quadratic · y² + cubic · y³).
    """

    WHERE: ClassVar[str] = "refinement.sensors"

    scale: Literal["shared"] = key(LEFT_OUT, "shared = all windows have one, > 0; left out = 1")
    offset: Literal["shared"] = key(LEFT_OUT, "shared = all windows have one, in the component's unit; left out = 0")
    quadratic: Literal["shared"] = key(
        LEFT_OUT, "shared = all windows have one, per the component's unit: a scale that changes along it; left out = 0"
    )
    cubic: Literal["shared"] = key(
        LEFT_OUT,
        "shared = all windows have one, per the component's unit squared: a scale that changes on both sides, as of a "
        "sensor that saturates; left out = 0",
    )

    @model_validator(mode="after")
    def _estimates_something(self) -> Self:
        if not self.sought:
            raise disagree("names nothing", f"give one or some of {', '.join(type(self).model_fields)}: shared")
        return self

    @property
    def sought(self) -> list[str]:
        """Which of the constants are estimated."""
        return [name for name in type(self).model_fields if getattr(self, name) is not None]


class RefinementSettings(Settings):
    """Least squares on each observed window: of the expert alone, or from a trained model's estimates."""

    WHERE: ClassVar[str] = "refinement"

    starts: Annotated[int, Field(ge=0, le=100_000)] = key(
        32,
        "number of points of p⁺ at which each window is compared with the model; 0 = only from the trained model's "
        "estimate",
    )
    tries: Count = key(
        3,
        "how many of these points, the best ones, the fit starts from in addition to the trained model's own estimate",
    )
    sufficient: Annotated[float, Field(ge=0, lt=1)] = key(
        0.99,
        "a window is fitted from further starts only where χ² after the first fit, that from the trained model's "
        "estimate or else from the best point, is above this quantile of its distribution; 0 = in any case",
    )
    agreement: Share = key(
        0.01,
        "no further start is tried once one has led to a χ² within this share of the lowest before it: two that arrive "
        "at the same minimum; 0 = all are tried until χ² is sufficient",
    )
    steps: Count = key(30, "maximum number of Levenberg–Marquardt steps")
    noise: Positive = key(
        LEFT_OUT,
        "standard deviation of the observation noise; left out = that of the data, or, where they have none, a "
        "thousandth of the training set's largest value (beside a learned F_a, which leaves more, try three times it)",
    )
    free_start: bool = key(
        LEFT_OUT, "whether the first point is estimated too; left out = only where the data have noise"
    )
    latent_width: Positive = key(
        3.0,
        "how far z_a may move from its mean over the training windows, in its standard deviations over them: a weak "
        "Gaussian prior",
    )
    latent: Annotated[int, Field(ge=1, le=AXES)] = key(
        10,
        "maximum number of components of an encoder's z_a that are fitted; of a longer z_a its first principal "
        "components over the training windows are, and the others stay at their mean",
    )
    windows: dict[str, Range] = key(
        LEFT_OUT, "first and last time at which each component counts, in s; left out = the whole observed window"
    )
    solver: SolverSettings = key(LEFT_OUT, "solver for the fit; left out = that of training")
    units: dict[str, Literal["window", "trajectory", "shared"]] = key(
        LEFT_OUT,
        "to what each expert parameter belongs: window = each window has its own; trajectory = all training windows of "
        "a trajectory have one; shared = all windows have one, fitted to the training windows together; left out = "
        "window. Of methods of kind least_squares_shared and alternating_shared and of refined versions; of kind "
        "hybrid_shared what is shared; of all others each window has its own",
    )
    population: dict[str, Literal["normal", "lognormal"]] = key(
        LEFT_OUT,
        "expert parameters that are not shared and whose values are draws from one distribution: its mean and spread "
        "are estimated from the training windows, and pull the estimate of a window, the more the less it tells; "
        "lognormal = the logarithm is normal. Of the same methods as units; left out = nothing pulls",
    )
    sensors: dict[str, SensorSettings] = key(
        LEFT_OUT,
        "constants of the sensors of components of the state, estimated with what is shared: forecasts are then what "
        "the sensors show. Of methods of kind least_squares_shared and alternating_shared alone; left out = the state "
        "itself is measured",
    )

    @property
    def shared(self) -> list[str]:
        """Names of the parameters that all windows share."""
        return [name for name, unit in (self.units or {}).items() if unit == "shared"]

    @property
    def tied(self) -> list[str]:
        """Names of the parameters that the training windows of a trajectory share."""
        return [name for name, unit in (self.units or {}).items() if unit == "trajectory"]

    @property
    def alone(self) -> "RefinementSettings":
        """The same where each window is fitted by itself, as if its sensors showed the state."""
        return self.model_copy(update={"units": {}, "sensors": {}, "population": {}})

    @property
    def of_sensors(self) -> list[tuple[str, str]]:
        """Component and name of each constant of a sensor that is estimated."""
        return [(component, name) for component, sensor in (self.sensors or {}).items() for name in sensor.sought]

    @property
    def holds(self) -> bool:
        """Whether there are constants of all windows."""
        return bool(self.shared or self.of_sensors)

    @property
    def shares(self) -> bool:
        """Whether windows share anything, be it the distribution of a parameter."""
        return bool(self.holds or self.tied or self.population)


class Constant(Settings):
    """A parameter that all windows share, as it was estimated, in its unit."""

    value: float = key(..., "estimate; of several seeds the mean of theirs")
    seeds: list[float] = key(LEFT_OUT, "estimate of each seed, where F_a was learned with it")
    std: NotNegative = key(..., "its standard error")
    groups: Count = key(1, "number of groups of windows that this is from and that count as independent")

    @classmethod
    def of_seeds(cls, each: Sequence["Constant"]) -> "Constant":
        """Of the same constant with the F_a of each seed; its error is the root of the mean square of theirs."""
        values = [constant.value for constant in each]
        std = math.sqrt(sum(constant.std**2 for constant in each) / len(each))
        return cls(value=sum(values) / len(values), seeds=values, std=std, groups=each[0].groups)

    @property
    def error(self) -> float:
        """Standard error of the estimate, with that of the mean over seeds."""
        several = self.seeds if self.seeds and len(self.seeds) > 1 else None
        return self.std if several is None else math.hypot(self.std, statistics.stdev(several) / len(several) ** 0.5)

    @property
    def held(self) -> float | list[float]:
        """What fits of windows hold it at: one value, or one of each seed."""
        return self.seeds or self.value

    def at(self, places: Sequence[int]) -> "Constant":
        """Of some of the seeds, by their places."""
        if not self.seeds:
            return self
        values = [self.seeds[k] for k in places]
        return self.model_copy(update={"value": sum(values) / len(values), "seeds": values})


class SensorConstants(Settings):
    """What was estimated of the sensor of a component of the state (:class:`SensorSettings`)."""

    scale: Constant = key(LEFT_OUT, "measured per true change; left out = 1")
    offset: Constant = key(LEFT_OUT, "what is measured where the state is 0, in the component's unit; left out = 0")
    quadratic: Constant = key(LEFT_OUT, "of the curve, per the component's unit; left out = 0")
    cubic: Constant = key(LEFT_OUT, "of the curve, per the component's unit squared; left out = 0")

    @classmethod
    def of_seeds(cls, each: Sequence["SensorConstants"]) -> "SensorConstants":
        """Of the same sensor with the F_a of each seed."""
        return cls.of(**{name: Constant.of_seeds([getattr(sensor, name) for sensor in each]) for name in each[0].known})

    @property
    def known(self) -> list[str]:
        """Names of what was estimated."""
        return [name for name in type(self).model_fields if getattr(self, name) is not None]

    def at(self, places: Sequence[int]) -> "SensorConstants":
        """Of some of the seeds, by their places."""
        return type(self).of(**{name: getattr(self, name).at(places) for name in self.known})


class Population(Settings):
    """The distribution of a parameter over windows, or over trajectories, as it was estimated."""

    form: Literal["normal", "lognormal"] = key(..., "lognormal = the logarithm is normal")
    middle: Constant = key(..., "mean, of a lognormal one the median, in the parameter's unit")
    spread: Constant = key(..., "standard deviation in the parameter's unit, of a lognormal one that of the logarithm")
    unit: Literal["window", "trajectory"] = key(..., "whose values it is of")

    @classmethod
    def of_seeds(cls, each: Sequence["Population"]) -> "Population":
        """Of the same parameter with the F_a of each seed."""
        middle, spread = (Constant.of_seeds([getattr(own, name) for own in each]) for name in ("middle", "spread"))
        return cls(form=each[0].form, unit=each[0].unit, middle=middle, spread=spread)

    def at(self, places: Sequence[int]) -> "Population":
        """Of some of the seeds, by their places."""
        return self.model_copy(update={"middle": self.middle.at(places), "spread": self.spread.at(places)})


class Refinement(Settings):
    """Least squares on each window: how to fit, and what is known of the data."""

    WHERE: ClassVar[str] = "refinement"

    settings: RefinementSettings = key(..., "how to fit")
    noise: Noise = key(..., "standard deviation of the data's noise")
    prior: Prior | None = key(
        ..., "range of each expert parameter in which the fits start; null = none, own = they are found (own-prior)"
    )
    shared: dict[str, Constant] = key(LEFT_OUT, "constants of all windows, where some are shared")
    sensors: dict[str, SensorConstants] = key(LEFT_OUT, "constants of sensors, where some were estimated")
    trajectories: dict[str, dict[str, Constant]] = key(
        LEFT_OUT, "estimates for each training trajectory by parameter, where its windows share some"
    )
    population: dict[str, Population] = key(LEFT_OUT, "distributions of parameters, where some were estimated")
    overdispersion: list[Positive] = key(
        LEFT_OUT,
        "of each seed, or of all: by how much residuals tell less than independent ones of the stated noise would, "
        "which intervals take into account: their correlation time in points times χ² per degree of freedom",
    )

    def of_seeds(self, places: Sequence[int]) -> "Refinement":
        """The same for some of the seeds, by their places."""
        estimated = {name: blocks for name in ("shared", "sensors", "population") if (blocks := getattr(self, name))}
        chosen: dict[str, object] = {
            name: {key: estimate.at(places) for key, estimate in blocks.items()} for name, blocks in estimated.items()
        }
        if self.overdispersion and len(self.overdispersion) > 1:
            chosen["overdispersion"] = [self.overdispersion[k] for k in places]
        if self.trajectories:
            tied = self.trajectories.items()
            chosen["trajectories"] = {name: {of: k.at(places) for of, k in each.items()} for name, each in tied}
        return self.model_copy(update=chosen)
