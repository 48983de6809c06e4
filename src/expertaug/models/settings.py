"""Kinds of encoders and interaction models, by name alone, and their arguments; no torch is loaded."""

import inspect
from collections.abc import Callable, Mapping
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar

from pydantic import AfterValidator, Field, model_validator
from pydantic.fields import FieldInfo

from expertaug.registry import Part
from expertaug.settings import (
    LEFT_OUT,
    Positive,
    Range,
    Settings,
    check,
    disagree,
    key,
    wrong,
)
from expertaug.systems.settings import SYSTEMS
from expertaug.wording import show, suggest

Module = TypeVar("Module")
WIDEST = 2**16
MARGIN = 0.1  # of the range of the training windows' z_a, by which a window's may lie beyond it
AXES = 100  # principal components of an encoder's z_a that a model file keeps, for fits of windows
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


class DriveSettings(PartSettings):
    """A function of the time, of each window's own."""

    WHERE: ClassVar[str] = "model.interaction"
    COMPONENTS = ("components",)
    CLASS = "drive:DriveInteraction"

    kind: Literal["drive"] = key("drive", "a sum of sines and cosines of the time, whose amplitudes are z_a")
    harmonics: int = key(8, "the last; the k-th has k half periods in the observed window", ge=1, le=256)
    lowest: int = key(1, "the first", ge=1, le=256)
    components: Names | None = key(None, "F_a acts on the rates of these components; null = all")
    start: Positive = key(1.0, "amplitudes at the start, in the unit of the rates")

    @model_validator(mode="after")
    def _first_and_last(self) -> Self:
        if self.lowest > self.harmonics:
            raise disagree(f"found {self.lowest}", f"give {self.harmonics}, the last, or less", "lowest")
        return self


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
    MLPSettings, ConvInteractionSettings, PolynomialSettings, DampingSettings, DriveSettings, EquationSettings
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
