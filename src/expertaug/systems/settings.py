"""Settings of the solver and arguments of the package's own systems; torch is not loaded here."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

from expertaug.settings import LIST, ONE, Pair, Positive, Settings, by_shape, key

EVENTS = "rk4"  # the method that stops at events
ADAMS = {"ab4": 4, "ab5": 5}  # Adams–Bashforth methods, by order
SPLITTING = ("lawson4", *ADAMS)  # which have a linear part exact
FIXED = ("euler", "midpoint", "rk4", "rodas3", *SPLITTING)


# Systems with an energy that their expert conserves, and the number of components that it is of.
CONSERVING = {"pendulum": 2, "double_pendulum": 4}


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


class SystemSettings(Settings):
    """Arguments of a system's class.

    Attributes:
        STATE, EXPERT, INTERACTION: names of the state's components, of z_e and of the simulation's z_a.
        SIMULATED: whether it can be simulated.
        FIELDS: whether its state is fields on a grid.
        EVENTS: whether it has events.
    """

    WHERE: ClassVar[str] = "system"
    STATE: ClassVar[tuple[str, ...]]
    EXPERT: ClassVar[tuple[str, ...]]
    INTERACTION: ClassVar[tuple[str, ...]] = ()
    SIMULATED: ClassVar[bool] = True
    FIELDS: ClassVar[bool] = False
    EVENTS: ClassVar[bool] = False

    @classmethod
    def inputs(cls, settings: Mapping) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Names of the known inputs of a system of these settings, and of what simulated ones are drawn from."""
        return (), ()

    @classmethod
    def jumps(cls, settings: Mapping) -> bool:
        """Whether what is observed jumps at events."""
        return False


class PendulumSettings(SystemSettings):
    """The damped pendulum."""

    STATE = ("theta", "omega")
    EXPERT = ("omega0",)
    INTERACTION = ("alpha",)

    name: Literal["pendulum"] = key("pendulum", "the damped pendulum")


class DrivenPendulumSettings(SystemSettings):
    """The driven, damped pendulum."""

    STATE = ("theta", "omega")
    EXPERT = ("omega0",)
    INTERACTION = ("gamma",)

    name: Literal["driven_pendulum"] = key("driven_pendulum", "the driven, damped pendulum")

    @classmethod
    def inputs(cls, settings: Mapping) -> tuple[tuple[str, ...], tuple[str, ...]]:
        return ("torque",), ("A", "f")


class BouncingBallSettings(SystemSettings):
    """A ball that bounces."""

    STATE = ("h", "v")
    EXPERT = ("g", "e")
    INTERACTION = ("k",)
    EVENTS = True

    name: Literal["bouncing_ball"] = key("bouncing_ball", "a ball that bounces on the ground")
    rest_m_s: float = key(0.05, "a ball that leaves the ground more slowly than this stays there", "m/s", ge=0)
    observed: Literal["all", "height"] = key(
        "all", "which components' errors count; F_a can be learned only with height, since speeds jump"
    )

    @classmethod
    def jumps(cls, settings: Mapping) -> bool:
        return settings.get("observed") != "height"


class RLCSettings(SystemSettings):
    """The RLC circuit."""

    STATE = ("U", "I")
    EXPERT = ("L", "C")
    INTERACTION = ("R",)

    name: Literal["rlc"] = key("rlc", "the RLC circuit")
    equations: Literal["kirchhoff", "additive", "code"] = key(
        "kirchhoff", "what the resistor's term is divided by: kirchhoff = L; additive = C, as in the paper; code = L C"
    )
    source_rad_s: float = key(2.0, "angular frequency of the source", "rad/s")
    source: Literal["formula", "measured"] = key(
        "formula",
        "the source's voltage: formula = by the system's own formula; measured = a known input of each trajectory",
    )

    @classmethod
    def inputs(cls, settings: Mapping) -> tuple[tuple[str, ...], tuple[str, ...]]:
        return (("V",), ("V0", "V1", "w")) if settings.get("source") == "measured" else ((), ())


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


class PendulumConstants(Settings):
    """Constants of the rigid double pendulum."""

    B1: float = key(..., "coupling of the first arm to the second")
    G1: float = key(..., "gravity on the first arm", "s⁻²")
    B2: float = key(..., "coupling of the second arm to the first")
    G2: float = key(..., "gravity on the second arm", "s⁻²")


class DoublePendulumSettings(SystemSettings):
    """The planar double pendulum."""

    STATE = ("theta1", "theta2", "omega1", "omega2")
    EXPERT = ("omega1", "omega2")
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


SYSTEMS: Mapping[str, type[SystemSettings]] = {
    kind.model_fields["name"].default: kind
    for kind in (
        PendulumSettings,
        DrivenPendulumSettings,
        BouncingBallSettings,
        RLCSettings,
        ReactionDiffusionSettings,
        DoublePendulumSettings,
    )
}
