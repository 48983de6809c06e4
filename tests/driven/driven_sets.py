"""Tiny sets of the driven pendulum in phys-vae's ranges, and models of it."""

import numpy as np

import expertaug as ea

T = np.arange(21) * 0.05
FREQUENCY, DAMPING = {"omega0": (0.785, 3.14)}, {"gamma": (0.0, 0.8)}
TORQUE = {"A": (0.0, 40.0), "f": (3.14, 6.28)}
WIDER = {"omega0": (0.5, 4.0)}
ENCODER = {"kind": "recurrent", "hidden": 8, "layers": [8]}
INTERACTION = {"kind": "mlp", "layers": [6, 6], "components": ["omega"], "inputs": True, "time": True}
OPTIONS = {"epochs": 2, "batch_size": 10, "learning_rate": 3e-3}


def simulated(name, n, **others):
    options = {"inputs": TORQUE, "n": n, "t": T, "noise": 0.01, "name": name} | others
    return ea.simulate(ea.DrivenPendulum(), FREQUENCY, DAMPING, **options)
