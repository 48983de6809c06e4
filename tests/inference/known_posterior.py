"""A system whose posterior is known, and what the tests of inference have in common."""

from torch import Tensor

from expertaug.config.presets import resolve
from expertaug.systems import Parameter, System

COMMON = {"experiment": "toy", "preset": "corrected", "choices": resolve("corrected"), "device": "cpu"}
NOISE = 0.3  # of the lines


class Line(System):
    """dy/dt = z_e: windows are straight lines, and least squares knows the posterior."""

    state = (Parameter("y"),)
    expert_parameters = (Parameter("slope", positive=False),)

    def expert(self, t: Tensor, y: Tensor, z_e: Tensor) -> Tensor:
        return z_e.expand_as(y)
