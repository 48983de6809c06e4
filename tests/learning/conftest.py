"""What the tests of learning share: a tiny pendulum experiment, and a model that is trained on it."""

from augmented_pendulum import trained  # noqa: F401
from quick_simulations import quick_simulations  # noqa: F401
from tiny import data, killed, settings  # noqa: F401
