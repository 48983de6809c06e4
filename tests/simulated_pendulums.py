"""What is simulated of pendulums in the tests of systems."""

from __future__ import annotations

from expertaug.systems.settings import SimulatedData, SimulatedSet


def pendulum_data(size=50, noise=0.0, alpha=(0.0, 0.6), t2_s=4.0):
    train = SimulatedSet(size=size, z_e={"omega0": (1.5, 3.1)}, z_a={"alpha": alpha})
    return SimulatedData(seed=0, step_s=0.1, t2_s=t2_s, noise=noise, sets={"train": train})
