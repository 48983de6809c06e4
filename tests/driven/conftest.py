"""What the tests of driven systems share: a tiny driven pendulum, trained once."""

import pytest
from driven_sets import ENCODER, INTERACTION, OPTIONS, WIDER, simulated

import expertaug as ea
from quick_simulations import quickly


@pytest.fixture(scope="session")
def sets():
    with quickly():
        return {name: simulated(name, n) for name, n in {"train": 40, "validation": 10, "test": 10}.items()}


@pytest.fixture(scope="session")
def recipe():
    return ea.HybridModel(ea.DrivenPendulum(), encoder=ENCODER, interaction=INTERACTION)


@pytest.fixture(scope="session")
def fit(sets, recipe):
    return ea.fit(recipe, sets["train"], sets["validation"], observed_s=0.5, seeds=[0, 1], **OPTIONS)


@pytest.fixture(scope="session")
def plus(sets, fit):
    return ea.finetune(fit, sets["train"], sets["validation"], prior=WIDER, noise=0.01, **OPTIONS)
