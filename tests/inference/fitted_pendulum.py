"""Windows of a pendulum, and the expert alone fitted to them, as several tests of inference share them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from cards import card
from expertaug import systems
from expertaug.inference.least_squares import estimator_of
from expertaug.models import store
from expertaug.models.decoder import Decoder
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.simulate import trajectories

T = np.linspace(0.0, 6.0, 61)
OBSERVED, NOISE = 51, 0.01
PRIOR = {"omega0": (0.5, 3.5)}


def expert_alone(name, data):
    bound = [10 * float(np.abs(data.y).max())] * data.y.shape[2]
    described = {"kind": "least_squares", "system": {"name": name}, "t": T.tolist(), "observed": OBSERVED}
    described |= {"bound": bound, "training": {}, "seeds": [0, 1]}
    return store.StoredModel(Decoder(systems.load({"name": name})), card(described))


def windows(data, seeds=2):
    y = torch.from_numpy(data.y).float().movedim(1, 0)[:OBSERVED].unsqueeze(1)
    return y.expand(-1, seeds, *y.shape[2:])


def pendulum(z_e, damping=(0.0, 0.0), n=40):
    return trajectories(DampedPendulum(), {"omega0": z_e}, {"alpha": damping}, n=n, t=T, noise=NOISE)


@pytest.fixture(scope="session")
def fitted():
    """The expert alone, which is the truth of undamped windows, fitted to each of them."""
    data = pendulum((0.8, 3.1), n=80)
    stored = expert_alone("pendulum", data)
    return replace(stored, model=estimator_of(stored, None, NOISE, PRIOR)), data
