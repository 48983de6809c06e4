"""What the tests of inference share: a tiny pendulum experiment, a fitted pendulum, and one for flows."""

from fitted_pendulum import fitted  # noqa: F401
from flow_pendulum import pendulum  # noqa: F401

from quick_simulations import quick_simulations  # noqa: F401
from tiny import data, killed, settings  # noqa: F401
