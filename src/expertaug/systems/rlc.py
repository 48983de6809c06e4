"""The RLC series circuit (paper, section 4.1): a resistor, an inductor and a capacitor on one voltage source."""

from __future__ import annotations

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.systems.base import Parameter, System

SOURCES = ("formula", "measured")
AMPLITUDE, OFFSET = 2.5, 1.0  # of the source, in V
EQUATIONS = ("kirchhoff", "additive", "code")


class RLC(System):
    """State (U, I): the capacitor's voltage in V and the current in A; z_e = (L, C), z_a = R.

    The expert knows dU/dt = I / C and dI/dt = (V(t) − U) / L, with the source V(t) = 2.5 sin(ω t) + 1; it lacks the
    resistance.

    Arguments:
        equations: what the resistance adds to dI/dt: ``kirchhoff`` −R I / L, the physics (Kirchhoff's voltage law
            V = U + R I + L dI/dt); ``additive`` −(R / C) I, the paper's F_a as printed; ``code`` −R I / (L C), what the
            authors' release simulates.  In each of them F_a depends on an expert parameter.
        source_rad_s: ω in rad/s; 2 made the published numbers, the paper's text has 4π.
        source: formula, or measured: V(t) is then a known input of each trajectory.  A simulated one has an offset V0,
            an amplitude V1 and an angular frequency w of its own; ``source_rad_s`` is unused.
    """

    state = (Parameter("U", "V"), Parameter("I", "A"))
    expert_parameters = (Parameter("L", "H", scale=2.0), Parameter("C", "F", scale=1.0))
    interaction_parameters = (Parameter("R", "ohm"),)

    def __init__(self, equations: str = "kirchhoff", source_rad_s: float = 2.0, source: str = "formula") -> None:
        if equations not in EQUATIONS:
            raise InputError("system.equations", repr(equations), f"one of {', '.join(EQUATIONS)}")
        if source not in SOURCES:
            raise InputError("system.source", repr(source), f"one of {', '.join(SOURCES)}")
        self.equations, self.source_rad_s, self.measured = equations, float(source_rad_s), source == "measured"
        if self.measured:
            self.inputs = (Parameter("V", "V", positive=False, scale=2.0),)
            self.input_parameters = (
                Parameter("V0", "V", positive=False),
                Parameter("V1", "V", positive=False),
                Parameter("w", "rad/s"),
            )

    def source(self, t: Tensor, *u: Tensor) -> Tensor:
        """V(t) in V: measured, or by formula."""
        return u[0][..., 0] if self.measured else AMPLITUDE * torch.sin(self.source_rad_s * t) + OFFSET

    def input_signal(self, t: Tensor, parameters: Tensor) -> Tensor:
        """V0 + V1 sin(w t)."""
        if not self.measured:
            return super().input_signal(t, parameters)
        offset, amplitude, frequency = parameters.unsqueeze(1).unbind(-1)
        return (offset + amplitude * torch.sin(frequency * t)).unsqueeze(-1)

    def expert(self, t: Tensor, y: Tensor, z_e: Tensor, *u: Tensor) -> Tensor:
        voltage, current = y.unbind(-1)
        inductance, capacitance = z_e.unbind(-1)
        return torch.stack((current / capacitance, (self.source(t, *u) - voltage) / inductance), dim=-1)

    def truth(self, t: Tensor, y: Tensor, z_e: Tensor, z_a: Tensor, *u: Tensor) -> Tensor:
        inductance, capacitance = z_e.unbind(-1)
        by = {"kirchhoff": inductance, "additive": capacitance, "code": inductance * capacitance}[self.equations]
        drop = -z_a[..., 0] * y[..., 1] / by
        return self.expert(t, y, z_e, *u) + torch.stack((torch.zeros_like(drop), drop), dim=-1)

    def sample_initial_state(self, n: int, generator: torch.Generator) -> Tensor:
        """U0 ~ N(0, 1), no current (paper, appendix)."""
        voltage = torch.randn(n, generator=generator, dtype=torch.float64)
        return torch.stack((voltage, torch.zeros_like(voltage)), dim=-1)
