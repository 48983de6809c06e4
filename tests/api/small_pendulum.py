"""A small pendulum experiment."""

import numpy as np

SEEN, SHIFTED = {"omega0": (1.5, 3.1)}, {"omega0": (0.5, 3.5)}
FRICTION = {"alpha": (0.0, 0.6)}
T = np.arange(21) * 0.1
ENCODER = {"kind": "recurrent", "hidden": 8, "layers": [8]}
INTERACTION = {"kind": "mlp", "layers": [6, 6]}
OPTIONS = {"epochs": 2, "batch_size": 10, "learning_rate": 3e-3}
