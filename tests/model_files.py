"""A small model file, as the tests of model files write it."""

from __future__ import annotations

from expertaug.models import store
from expertaug.models.card import ModelCard, PartsRecord
from expertaug.models.estimators import Hybrid
from expertaug.systems.pendulum import DampedPendulum

PENDULUM = DampedPendulum()
CARD = ModelCard(
    kind="hybrid",
    system={"name": "pendulum"},
    model=PartsRecord(
        encoder={"kind": "recurrent", "hidden": 2, "layers": [2]}, interaction={"kind": "mlp", "layers": [2]}
    ),
    expert=True,
    interaction=True,
    t=[0.1 * k for k in range(7)],
    observed=4,
    seeds=[3, 4],
)


def write(path, **changed):
    model = Hybrid.network(PENDULUM, CARD)
    store.save(path, model, CARD.but(**changed))
    return model
