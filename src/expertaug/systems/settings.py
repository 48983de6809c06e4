"""Settings of the solver and arguments of the package's own systems; torch is not loaded here."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, Union

from pydantic import ConfigDict, Discriminator, Field, Tag, field_validator, model_validator

from expertaug.settings import (
    LEFT_OUT,
    LIST,
    ONE,
    Name,
    NotNegative,
    Pair,
    Positive,
    Range,
    Settings,
    by_shape,
    disagree,
    key,
    wrong,
)
from expertaug.wording import suggest

EVENTS = "rk4"  # the method that stops at events
ADAMS = {"ab4": 4, "ab5": 5}  # Adams–Bashforth methods, by order
SPLITTING = ("lawson4", *ADAMS)  # which have a linear part exact
FIXED = ("euler", "midpoint", "rk4", "rodas3", *SPLITTING)


# Systems with an energy that their expert conserves, and the number of components that it is of.
CONSERVING = {"pendulum": 2, "double_pendulum": 4}
SYSTEMS: dict[str, type["SystemSettings"]] = {}  # the package's own, by name


class SolverSettings(Settings):
    """Of the differential equation."""

    WHERE: ClassVar[str] = "solver"

    method: Literal[
        "euler", "midpoint", "rk4", "lawson4", "ab4", "ab5", "rodas3", "dopri5", "dopri8", "radau", "bdf"
    ] = key(
        "rk4",
        "euler, midpoint, rk4, lawson4 (which treats a linear part of the expert exactly), ab4, ab5 (Adams–Bashforth; "
        "a quarter of the evaluations, that part likewise) and rodas3 (for stiff systems) step from data time to data "
        "time; dopri5, dopri8 and, for stiff systems but without gradients, radau and bdf choose their steps by "
        "tolerance",
    )
    rtol: Positive = key(1.0e-6, "relative tolerance of an adaptive method")
    atol: Positive = key(1.0e-6, "absolute tolerance of an adaptive method, in the state's units")
    substeps: int = key(1, "number of steps of a fixed-grid method between consecutive data times", ge=1, le=10_000)
    points_per_step: int = key(
        1,
        "the other way round, for a grid much finer than the measured points on it: how many points a step of a "
        "fixed-grid method goes on by; cubics lie between (not where measured inputs bend)",
        ge=1,
        le=10_000,
    )

    @model_validator(mode="after")
    def _either(self) -> Self:
        if self.substeps > 1 and self.points_per_step > 1:
            raise disagree(
                f"found {self.points_per_step}", "substeps divide steps: give one of the two", "points_per_step"
            )
        return self


@dataclass(frozen=True)
class InTables:
    """What tables of measurements need to know of a system beside its names, for torch not to be loaded for it.

    Attributes:
        units: of the state's components and the known inputs that have one.
        rates: component → the component whose rate of change it is.
        scales: typical sizes of the expert parameters that are not about one; all of them are positive.
        constants: whether these are constants of an apparatus, and do not say how a forecast starts.
        timed: whether the expert depends on t itself, where it has no known inputs.
    """

    units: Mapping[str, str] = field(default_factory=dict)
    rates: Mapping[str, str] = field(default_factory=dict)
    scales: Mapping[str, float] = field(default_factory=dict)
    constants: bool = True
    timed: bool = False


class SystemSettings(Settings):
    """Arguments of a system's class; a class of it that says its ``name`` is in :data:`SYSTEMS`.

    Attributes:
        name: the module of expertaug.systems, or what :func:`expertaug.systems.load` takes.
        STATE, EXPERT, INTERACTION: names of the state's components, of z_e and of the simulation's z_a.
        SIMULATED: whether it can be simulated.
        UNITS: of those of z_e and z_a that have one.
        STARTS: names of those of z_e that say how a forecast starts, and are no constants of an apparatus.
        FIELDS: whether its state is fields on a grid.
        EVENTS: whether it has events.
        TABLES: what tables of it need to know; None: its class is asked.
    """

    WHERE: ClassVar[str] = "system"
    STATE: ClassVar[tuple[str, ...]]
    EXPERT: ClassVar[tuple[str, ...]]
    INTERACTION: ClassVar[tuple[str, ...]] = ()
    UNITS: ClassVar[dict[str, str]] = {}
    STARTS: ClassVar[tuple[str, ...]] = ()
    SIMULATED: ClassVar[bool] = True
    FIELDS: ClassVar[bool] = False
    EVENTS: ClassVar[bool] = False
    TABLES: ClassVar[InTables | None] = None

    name: str

    @classmethod
    def __pydantic_init_subclass__(cls, **options: Any) -> None:
        """Register a system of the package."""
        super().__pydantic_init_subclass__(**options)
        if not cls.model_fields["name"].is_required():
            SYSTEMS[cls.model_fields["name"].default] = cls

    @property
    def expert_names(self) -> tuple[str, ...]:
        """Names of the expert parameters."""
        return self.EXPERT

    @property
    def interaction_names(self) -> tuple[str, ...]:
        """Names of the simulation's parameters of the interaction."""
        return self.INTERACTION

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the known inputs."""
        return ()

    @property
    def drawn(self) -> tuple[str, ...]:
        """Names of what simulated inputs are drawn from."""
        return ()

    @property
    def jumps(self) -> bool:
        """Whether what is observed jumps at events."""
        return False


class PendulumSettings(SystemSettings):
    """The damped pendulum."""

    STATE = ("theta", "omega")
    EXPERT = ("omega0",)
    INTERACTION = ("alpha",)
    UNITS: ClassVar[dict[str, str]] = {"omega0": "rad/s", "alpha": "1/s"}
    TABLES = InTables({"theta": "rad", "omega": "rad/s"}, {"omega": "theta"})

    name: Literal["pendulum"] = key("pendulum", "the damped pendulum")
    friction: Literal["estimated"] | None = key(
        None,
        "estimated = the expert knows the damping, whose rate alpha is an expert parameter; null = F_a learns it",
    )
    start_radius: Range | None = key(
        None,
        "range of the distance from rest, in (theta, omega), at which simulations start in any direction; null = at "
        "rest within a quarter of a turn",
    )
    observed: Literal["all", "angle"] = key("all", "which components' errors count")

    @property
    def expert_names(self) -> tuple[str, ...]:
        return self.EXPERT if self.friction is None else (*self.EXPERT, *self.INTERACTION)

    @property
    def interaction_names(self) -> tuple[str, ...]:
        return self.INTERACTION if self.friction is None else ()


class DrivenPendulumSettings(SystemSettings):
    """The driven, damped pendulum."""

    STATE = ("theta", "omega")
    EXPERT = ("omega0",)
    INTERACTION = ("gamma",)
    DRAWN: ClassVar[tuple[str, ...]] = ("A", "f")
    UNITS: ClassVar[dict[str, str]] = {"omega0": "rad/s", "gamma": "1/s", "f": "Hz"}
    TABLES = InTables({"theta": "rad", "omega": "rad/s"}, {"omega": "theta"})

    name: Literal["driven_pendulum"] = key("driven_pendulum", "the driven, damped pendulum")
    torque: Literal["known", "hidden"] = key(
        "known", "known = a known input of each trajectory; hidden = what F_a has to learn, with its A and f in z_a"
    )
    observed: Literal["all", "angle"] = key("all", "which components' errors count")

    @property
    def interaction_names(self) -> tuple[str, ...]:
        return self.INTERACTION if self.torque == "known" else (*self.INTERACTION, *self.DRAWN)

    @property
    def inputs(self) -> tuple[str, ...]:
        return ("torque",) if self.torque == "known" else ()

    @property
    def drawn(self) -> tuple[str, ...]:
        return self.DRAWN if self.torque == "known" else ()


class LorenzSettings(SystemSettings):
    """Lorenz's system."""

    STATE = ("x", "y", "z")
    EXPERT = ("sigma", "beta")
    INTERACTION = ("rho",)
    TABLES = InTables(scales={"sigma": 10.0, "beta": 3.0})

    name: Literal["lorenz"] = key("lorenz", "Lorenz's system of convection")


class LotkaVolterraSettings(SystemSettings):
    """Predators and prey."""

    STATE = ("u", "v")
    EXPERT = ("a", "c")
    INTERACTION = ("b", "d")
    UNITS: ClassVar[dict[str, str]] = {"a": "1/s", "b": "1/s", "c": "1/s", "d": "1/s"}
    TABLES = InTables()

    name: Literal["lotka_volterra"] = key("lotka_volterra", "predators and prey")


class BouncingBallSettings(SystemSettings):
    """A ball that bounces."""

    STATE = ("h", "v")
    EXPERT = ("g", "e")
    INTERACTION = ("k",)
    UNITS: ClassVar[dict[str, str]] = {"g": "m/s²", "k": "1/s"}
    EVENTS = True
    TABLES = InTables({"h": "m", "v": "m/s"}, {"v": "h"}, {"g": 10.0, "e": 0.8}, constants=False)

    name: Literal["bouncing_ball"] = key("bouncing_ball", "a ball that bounces on the ground")
    rest_m_s: float = key(0.05, "a ball that leaves the ground more slowly than this stays there", "m/s", ge=0)
    observed: Literal["all", "height"] = key(
        "all", "which components' errors count; F_a can be learned only with height, since speeds jump"
    )

    @property
    def jumps(self) -> bool:
        return self.observed != "height"


class RLCSettings(SystemSettings):
    """The RLC circuit."""

    STATE = ("U", "I")
    EXPERT = ("L", "C")
    INTERACTION = ("R",)
    UNITS: ClassVar[dict[str, str]] = {"L": "H", "C": "F", "R": "ohm"}
    TABLES = InTables({"U": "V", "I": "A", "V": "V"}, scales={"L": 2.0}, timed=True)

    name: Literal["rlc"] = key("rlc", "the RLC circuit")
    equations: Literal["kirchhoff", "additive", "code"] = key(
        "kirchhoff", "what the resistor's term is divided by: kirchhoff = L; additive = C, as in the paper; code = L C"
    )
    source_rad_s: float = key(2.0, "angular frequency of the source", "rad/s")
    source: Literal["formula", "measured"] = key(
        "formula",
        "the source's voltage: formula = by the system's own formula; measured = a known input of each trajectory",
    )

    @property
    def inputs(self) -> tuple[str, ...]:
        return ("V",) if self.source == "measured" else ()

    @property
    def drawn(self) -> tuple[str, ...]:
        return ("V0", "V1", "w") if self.source == "measured" else ()


class ReactionDiffusionSettings(SystemSettings):
    """Reaction–diffusion on a periodic grid."""

    STATE = ("u", "v")
    EXPERT = ("a", "b")
    INTERACTION = ("k",)
    FIELDS = True

    name: Literal["reaction_diffusion"] = key("reaction_diffusion", "reaction–diffusion on a periodic grid")
    reaction: Literal[False, "without_k"] = key(
        False, "what the expert knows of the reaction: false = nothing; without_k = all but k, as in the authors' code"
    )


class WaveSettings(SystemSettings):
    """The damped wave equation."""

    STATE = ("w", "w_t")
    EXPERT = ("c",)
    INTERACTION = ("k",)
    UNITS: ClassVar[dict[str, str]] = {"c": "m/s", "k": "1/s"}
    FIELDS = True

    name: Literal["wave"] = key("wave", "the damped wave equation on a square of 63 m")
    cells: int = key(64, "points along a side of the square", ge=4, le=4096)


class AdvectionDiffusionSettings(SystemSettings):
    """Advection and diffusion along a line."""

    STATE = ("u",)
    EXPERT = ("D",)
    INTERACTION = ("c",)
    UNITS: ClassVar[dict[str, str]] = {"D": "m²/s", "c": "m/s"}
    FIELDS = True

    name: Literal["advection_diffusion"] = key("advection_diffusion", "advection and diffusion on 20 points")


class PendulumConstants(Settings):
    """Constants of the rigid double pendulum."""

    B1: float = key(..., "coupling of the first arm to the second")
    G1: float = key(..., "gravity on the first arm", "s⁻²")
    B2: float = key(..., "coupling of the second arm to the first")
    G2: float = key(..., "gravity on the second arm", "s⁻²")


class DoublePendulumSettings(SystemSettings):
    """The planar double pendulum."""

    STATE = ("theta1", "theta2", "omega1", "omega2")
    EXPERT = STARTS = ("omega1", "omega2")
    UNITS: ClassVar[dict[str, str]] = {"omega1": "rad/s", "omega2": "rad/s"}
    SIMULATED = False

    name: Literal["double_pendulum"] = key("double_pendulum", "the planar double pendulum")
    expert: Literal["compound", "point_mass"] = key(
        "compound",
        "compound = a rigid body with fitted constants; point_mass = two equal point masses, as in the paper",
    )
    constants: PendulumConstants | None = key(
        None, "constants of the compound expert; null = those that data.calibrate fits"
    )
    l1: Positive = key(0.091, "length of the first arm, for the point masses", "m")
    l2: Positive = key(0.070, "length of the second arm, for the point masses", "m")
    friction: Annotated[Annotated[Literal["calibrated"] | None, ONE] | Annotated[Pair, LIST], by_shape] = key(
        None,
        "friction of the two joints, which the expert then knows; calibrated = what data.calibrate fits; null = none",
        "1/s",
    )


class UserSystemSettings(SystemSettings):
    """A class from elsewhere, whose constructor knows its arguments."""

    model_config = ConfigDict(extra="allow")

    name: str = key(..., "a dotted path of a module that defines one System, or module:Class")

    @field_validator("name")
    @classmethod
    def _is_from_elsewhere(cls, name: str) -> str:
        if "." not in name and ":" not in name:
            raise wrong(f"'{name}' is no system", f"{suggest(name, SYSTEMS)}, or the dotted path of a module elsewhere")
        return name


def _tag(settings: object) -> str:
    name = settings.get("name") if isinstance(settings, Mapping) else getattr(settings, "name", None)
    return f"@{name}" if name in SYSTEMS else "@user"


if TYPE_CHECKING:
    AnySystem = SystemSettings
else:  # of its name's own class
    AnySystem = Annotated[
        Union[
            *(Annotated[kind, Tag(f"@{name}")] for name, kind in SYSTEMS.items()),
            Annotated[UserSystemSettings, Tag("@user")],
        ],
        Discriminator(_tag),
    ]


class SimulatedSet(Settings):
    """One simulated set."""

    size: int = key(..., "number of trajectories", ge=1, le=10**8)
    z_e: dict[str, Range] = key(..., "range of each expert parameter, in its unit")
    z_a: dict[str, Range] = key(dict, "range of each parameter of the true interaction, in its unit")
    inputs: dict[str, Range] = key(
        LEFT_OUT,
        "for a driven system: the range of each number from which the known inputs are drawn, and of each covariate",
    )


class SimulatedData(Settings):
    """What is simulated."""

    seed: Annotated[int, Field(ge=0, lt=2**31)] = key(..., "of the simulation")
    step_s: Positive = key(..., "time from point to point", "s")
    t2_s: Positive = key(..., "end of a trajectory", "s")
    noise: NotNegative = key(..., "standard deviation of the noise on every value of the state")
    sets: dict[Name, SimulatedSet] = key(..., "the sets by name")


class SimulateJob(Settings):
    """Settings of the stage simulate."""

    WHERE: ClassVar[str] = "--settings"

    system: AnySystem = key(..., "name and arguments of the system")
    data: SimulatedData = key(..., "what is simulated")
