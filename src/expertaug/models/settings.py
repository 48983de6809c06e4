"""Kinds of encoders and interaction models, by name alone, and their arguments; how windows are fitted.

No torch is loaded.
"""

import inspect
import math
import statistics
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar

from pydantic import AfterValidator, Field, model_validator
from pydantic.fields import FieldInfo

from expertaug.registry import Part
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
    check,
    disagree,
    key,
    wrong,
)
from expertaug.systems.settings import SYSTEMS, SolverSettings
from expertaug.wording import show, suggest

Module = TypeVar("Module")
WIDEST = 2**16
MARGIN = 0.1  # of the range of the training windows' z_a, by which a window's may lie beyond it
AXES = 32  # principal components of an encoder's z_a that a model file keeps, for fits of windows
TOLD = 0.5  # of the width of p⁺: an interval as wide says nothing of a parameter
Width = Annotated[int, Field(ge=1, le=WIDEST)]
Widths = Annotated[tuple[Width, ...], Field(strict=False, max_length=100)]
Hidden = Annotated[tuple[Width, ...], Field(strict=False, min_length=1, max_length=100)]
Strides = Annotated[tuple[Annotated[int, Field(ge=1, le=64)], ...], Field(strict=False, max_length=100)]
Powers = Annotated[tuple[Annotated[int, Field(ge=1, le=20)], ...], Field(strict=False, min_length=1, max_length=20)]
Names = Annotated[tuple[str, ...], Field(strict=False)]
Activation = Literal["relu", "silu", "selu", "tanh"]
LATENT = "size of z_a"
START = "initial size of the last layer, as a multiple of the usual one; near zero the expert is alone at first"
ACTIVATION = "activation function of the network"


class PartSettings(Settings):
    """Arguments of a class that a model is made of; :func:`configure_by` gives them to the class.

    Attributes:
        CLASS: ``module:Class`` in the folder of its part.
        COMPONENTS: keys that name components of the state.
        FIELDS: whether it is for states that are fields on a grid.
    """

    CLASS: ClassVar[str]
    COMPONENTS: ClassVar[tuple[str, ...]] = ()
    FIELDS: ClassVar[bool] = False

    @classmethod
    def arguments(cls) -> dict[str, FieldInfo]:
        """What a constructor takes of them: all but the kind."""
        return {name: field for name, field in cls.model_fields.items() if name != "kind"}


def configure_by(settings: type[PartSettings]) -> Callable[[type[Module]], type[Module]]:
    """A class whose constructor hands ``**options`` to ``settings``: its signature and the end of its docstring, its
    arguments, are made from these."""

    def configured(cls: type[Module]) -> type[Module]:
        signature = inspect.signature(cls.__init__)
        own = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
        own += [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=_default(field))
            for name, field in settings.arguments().items()
        ]
        cls.__init__.__signature__ = signature.replace(parameters=own)  # type: ignore[attr-defined]
        lines = [f"    {name}: {field.description}." for name, field in settings.arguments().items()]
        cls.__doc__ = "\n".join((inspect.cleandoc(cls.__doc__ or ""), *lines))
        return cls

    return configured


def _default(field: FieldInfo) -> object:
    return inspect.Parameter.empty if field.is_required() else field.get_default()


class EncoderSettings(PartSettings):
    """Arguments of an encoder's class."""

    WHERE: ClassVar[str] = "model.encoder"


class WindowSettings(EncoderSettings):
    """A fully connected network of windows of chosen components."""

    CLASS = "window:WindowEncoder"
    COMPONENTS = ("windows", "angles")

    kind: Literal["window"] = key("window", "a fully connected network on windows of chosen components")
    windows: dict[str, Range] = key(
        ...,
        "first and last time at which each component named here is seen; the first point is seen as well",
        "s",
        min_length=1,
    )
    angles: Names = key((), "components that enter as angles: as sine, cosine and the sines of their increments")
    layers: Hidden = key((300, 300, 300), "widths of the hidden layers")
    latent: Width = key(10, LATENT)
    activation: Activation = key("relu", ACTIVATION)
    skip: bool = key(False, "whether a linear map of the inputs is added to the estimate of z_e")


class RecurrentSettings(EncoderSettings):
    """A recurrent network over the observed states."""

    CLASS = "recurrent:RecurrentEncoder"

    kind: Literal["recurrent"] = key("recurrent", "a GRU over the observed states; its last state is z_a")
    hidden: Width = key(128, "size of the recurrent state, which is z_a")
    layers: Widths = key((150, 150, 150), "widths of the hidden layers that estimate z_e")


class TwoStepSettings(EncoderSettings):
    """The hybrid-VAE's encoder: z_a first, then z_e of what the expert alone could have made."""

    CLASS = "two_step:MLPTwoStep"
    COMPONENTS = ("windows", "angles")

    kind: Literal["two_step"] = key(
        "two_step", "the hybrid-VAE's encoder: first z_a, then z_e from the filtered window"
    )
    latent: Width = key(1, LATENT)
    latent_layers: Widths = key((256, 256, 128, 32), "widths of the hidden layers of g_a, which gives z_a")
    filter_layers: Widths = key(
        (128, 128), "widths of the hidden layers of g_p1, which removes what the interaction did"
    )
    expert_layers: Widths = key((128, 128, 256, 64, 32), "widths of the hidden layers of g_p2, which gives z_e")
    windows: Annotated[dict[str, Range], Field(min_length=1)] | None = key(
        None, "first and last time at which each component named here is seen; null = every observed state", "s"
    )
    angles: Names = key((), "components of the windows that enter as angles")
    skip: bool = key(False, "whether a linear map of the inputs is added to the estimate of z_e")
    activation: Activation = key("selu", ACTIVATION)


class _Convolutions(EncoderSettings):
    """Layers of 3 × 3 convolutions."""

    FIELDS = True

    @model_validator(mode="after")
    def _one_stride_a_layer(self) -> Self:
        channels, strides = (getattr(self, name) for name in ("channels", "strides"))
        if len(strides) != len(channels):
            raise disagree(
                f"found {list(strides)}", f"give {len(channels)} of them, one for each of channels", "strides"
            )
        return self


class ConvSettings(_Convolutions):
    """A convolutional network of the observed fields."""

    CLASS = "fields:ConvEncoder"

    kind: Literal["conv"] = key("conv", "a convolutional network on the observed fields")
    channels: Hidden = key((32, 32, 64), "channels of the convolutional layers, 3 × 3 each")
    strides: Strides = key((1, 2, 2), "strides of these layers")
    layers: Hidden = key((128,), "widths of the hidden layers of the network on the averages of these layers")
    latent: Width = key(10, LATENT)


class ConvTwoStepSettings(_Convolutions):
    """The hybrid-VAE's encoder for fields."""

    CLASS = "two_step:ConvTwoStep"

    kind: Literal["conv_two_step"] = key("conv_two_step", "the hybrid-VAE's encoder for fields")
    latent: Width = key(10, LATENT)
    channels: Hidden = key((32, 32, 64), "channels of the convolutional layers of g_a and g_p2, 3 × 3 each")
    strides: Strides = key((1, 2, 2), "strides of these layers")
    layers: Widths = key((128,), "widths of the hidden layers of the networks on the averages of these layers")
    filter_channels: Hidden = key((16, 32, 32), "channels of the levels of the U-Net g_p1")
    powers: Powers | None = key(None, "powers of the fields whose moments g_a and g_p2 see; null = convolutions")


class MomentSettings(EncoderSettings):
    """A fully connected network of moments of the observed fields."""

    CLASS = "fields:MomentEncoder"
    FIELDS = True

    kind: Literal["moments"] = key("moments", "a fully connected network on moments of the observed fields")
    powers: Powers = key((1, 3), "powers of the fields whose moments are taken")
    layers: Hidden = key((128, 128), "widths of the hidden layers")
    latent: Width = key(1, LATENT)
    activation: Activation = key("silu", ACTIVATION)


class InteractionSettings(PartSettings):
    """Arguments of an interaction model's class."""

    WHERE: ClassVar[str] = "model.interaction"
    COMPONENTS = ("components", "reads")

    expert_parameters: bool = key(False, "whether F_a sees z_e too")


class MLPSettings(InteractionSettings):
    """A fully connected network of the state and z_a."""

    CLASS = "mlp:MLPInteraction"

    kind: Literal["mlp"] = key("mlp", "a fully connected network on the state and z_a")
    layers: Hidden = key((50, 50, 50), "widths of the hidden layers")
    activation: Activation = key("relu", ACTIVATION)
    components: Names | None = key(None, "F_a acts on the rates of these components; null = all")
    reads: Names | None = key(None, "components that F_a sees; null = all")
    inputs: bool = key(False, "whether F_a sees the system's known inputs")
    time: bool = key(False, "whether F_a sees the time")
    harmonics: int = key(
        0,
        "how many harmonics of the observed window F_a sees in place of the time, sine and cosine of each, where a "
        "drive that nobody measured is periodic; 0 = the time itself",
        ge=0,
        le=256,
    )
    start: Positive = key(1.0, START)

    @model_validator(mode="after")
    def _harmonics_of_the_time(self) -> Self:
        if self.harmonics and not self.time:
            raise disagree(f"found {self.harmonics}", "set time: true beside it, or leave it out", "harmonics")
        return self


class ConvInteractionSettings(InteractionSettings):
    """A convolutional network of the fields and z_a."""

    CLASS = "convolutional:ConvInteraction"
    FIELDS = True

    kind: Literal["conv"] = key("conv", "a convolutional network on the fields and z_a")
    channels: Hidden = key((16, 16), "channels of the hidden layers")
    kernels: Annotated[tuple[Annotated[int, Field(ge=1, le=99)], ...], Field(strict=False)] = key(
        (3, 3, 3), "odd kernel size of every layer, one more entry than channels; 1 = local"
    )
    precision: Literal["float32", "bfloat16"] = key("float32", "numerical precision of the convolutions")
    start: Positive = key(1.0, START)

    @model_validator(mode="after")
    def _one_odd_kernel_a_layer(self) -> Self:
        if len(self.kernels) != len(self.channels) + 1 or any(k % 2 == 0 for k in self.kernels):
            wanted = f"give {len(self.channels) + 1} odd sizes, one for each layer"
            raise disagree(f"found {list(self.kernels)}", wanted, "kernels")
        return self


class PolynomialSettings(InteractionSettings):
    """A polynomial of the state."""

    CLASS = "polynomial:PolynomialInteraction"

    kind: Literal["polynomial"] = key("polynomial", "a polynomial in the state, with coefficients that z_a may set")
    degree: int = key(3, "degree of the polynomial", ge=0, le=12)
    latent_degree: int = key(0, "degree up to which z_a sets the coefficients", ge=-1, le=12)
    layers: Widths = key((), "widths of the hidden layers of the network from z_a to these coefficients")
    components: Names | None = key(None, "F_a acts on the rates of these components; null = all")
    reads: Names | None = key(None, "components that F_a sees; null = all")


class DampingSettings(InteractionSettings):
    """A linear damping whose rate grows with z_a."""

    CLASS = "damping:DampingInteraction"

    kind: Literal["damping"] = key("damping", "a linear damping with a positive rate that grows with z_a")
    components: Names | None = key(None, "components that are damped, each in proportion to itself; null = all")


class EquationSettings(PartSettings):
    """Terms that can be read."""

    WHERE: ClassVar[str] = "model.interaction"
    CLASS = "equation:EquationInteraction"

    kind: Literal["equation"] = key("equation", "a sum of terms that are written as arithmetic")
    terms: Annotated[tuple[str, ...], Field(strict=False, max_length=100)] = key(
        ...,
        "each as `rate: expression`, such as `omega: abs(omega) * omega`, with components of the state, known inputs "
        "and expert parameters by name",
    )
    coefficients: Annotated[tuple[float | None, ...], Field(strict=False, max_length=100)] | None = key(
        None, "one for each term: a number, or null where it is a component of z_a; null = all are"
    )

    @model_validator(mode="after")
    def _one_coefficient_a_term(self) -> Self:
        if self.coefficients is not None and len(self.coefficients) != len(self.terms):
            raise disagree(
                f"found {len(self.coefficients)}", f"give {len(self.terms)}, one for each term", "coefficients"
            )
        return self


def _by_kind(*kinds: type[PartSettings]) -> dict[str, type[PartSettings]]:
    return {kind.model_fields["kind"].default: kind for kind in kinds}


def _part(name: str, kinds: Mapping[str, type[PartSettings]], given: tuple[str, ...]) -> Part:
    classes = {kind: f"expertaug.models.{name}s.{settings.CLASS}" for kind, settings in kinds.items()}
    return Part(name, classes, base="torch.nn:Module", needed="forward", given=given)


ENCODERS: Mapping[str, type[PartSettings]] = _by_kind(
    WindowSettings, RecurrentSettings, TwoStepSettings, ConvSettings, ConvTwoStepSettings, MomentSettings
)
INTERACTIONS: Mapping[str, type[PartSettings]] = _by_kind(
    MLPSettings, ConvInteractionSettings, PolynomialSettings, DampingSettings, EquationSettings
)
ENCODER = _part("encoder", ENCODERS, ("system", "times"))
INTERACTION = _part("interaction", INTERACTIONS, ("system", "latent", "times"))
PARTS = {part.name: part for part in (ENCODER, INTERACTION)}


def _check(value: dict[str, Any], kinds: Mapping[str, type[Settings]], name: str) -> dict[str, Any]:
    """Settings of a class, by its name under a key, where that is one of the package's own; others know their own."""
    called = value.get(name)
    if not isinstance(called, str) or (called not in kinds and not set(".:") & set(called)):
        raise wrong(
            "missing" if called is None else f"found {show(called)}",
            f"{suggest(called, kinds)}, or package.module:Class",
            name,
        )
    kind = kinds.get(called)
    if kind is not None and (errors := check(kind, value, "")):
        raise wrong(errors[0].found, errors[0].remedy, errors[0].where)
    return value


def _encoder(value: dict[str, Any]) -> dict[str, Any]:
    return _check(value, ENCODERS, "kind")


def _interaction(value: dict[str, Any]) -> dict[str, Any]:
    return _check(value, INTERACTIONS, "kind")


def _system(value: dict[str, Any]) -> dict[str, Any]:
    return _check(value, SYSTEMS, "name")


SystemKeys = Annotated[dict[str, Any], AfterValidator(_system)]


class PartsSettings(Settings):
    """What a model is made of: of each part its kind (a name, or package.module:Class) and its class's arguments."""

    WHERE: ClassVar[str] = "model"

    encoder: Annotated[dict[str, Any], AfterValidator(_encoder)] = key(LEFT_OUT, "of kind hybrid alone")
    interaction: Annotated[dict[str, Any], AfterValidator(_interaction)] = key(LEFT_OUT, "F_a, where there is one")


class SensorSettings(Settings):
    """What is estimated of the sensor of a component of the state: measured = scale · state + offset."""

    WHERE: ClassVar[str] = "refinement.sensors"

    scale: Literal["shared"] = key(LEFT_OUT, "shared = all windows have one, > 0; left out = 1")
    offset: Literal["shared"] = key(LEFT_OUT, "shared = all windows have one, in the component's unit; left out = 0")

    @model_validator(mode="after")
    def _estimates_something(self) -> Self:
        if not self.sought:
            raise disagree("names nothing", "give scale: shared, offset: shared, or both")
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
        "window. Of methods of kind least_squares_shared and alternating_shared and of refined versions alone: of all "
        "others each window has its own",
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
        """Component and name, scale or offset, of the constants of sensors that are estimated."""
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

    @classmethod
    def of_seeds(cls, each: Sequence["SensorConstants"]) -> "SensorConstants":
        """Of the same sensor with the F_a of each seed."""
        return cls.of(**{name: Constant.of_seeds([getattr(sensor, name) for sensor in each]) for name in each[0].known})

    @property
    def known(self) -> list[str]:
        """Names of what was estimated."""
        return [name for name in ("scale", "offset") if getattr(self, name) is not None]

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
