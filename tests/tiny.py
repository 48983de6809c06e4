"""A tiny pendulum experiment, and what the tests of learning and of inference share of it."""

from pathlib import Path
from typing import TypeVar

import pytest

from expertaug.learning.settings import Build, TrainJob, TrainSettings
from expertaug.learning.trainer import Trainer
from expertaug.models.settings import PartsSettings
from expertaug.presets import resolve
from expertaug.settings import Settings
from expertaug.systems.settings import PendulumSettings, SimulatedData, SimulatedSet, SimulateJob, SystemSettings
from expertaug.systems.simulate import simulate

Kind = TypeVar("Kind", bound=Settings)


def swings(size: int, alpha: tuple[float, float] = (0.0, 0.6)) -> SimulatedSet:
    return SimulatedSet(size=size, z_e={"omega0": (1.5, 3.1)}, z_a={"alpha": alpha})


DATA = SimulatedData(
    seed=0,
    step_s=0.1,
    t2_s=2.0,
    noise=0.01,
    sets={"train": swings(40), "validation": swings(10), "test": swings(10)},
)
SETTINGS = TrainJob(
    experiment="pendulum",
    method="aphynity",
    label="APHYNITY",
    preset="corrected",
    system={"name": "pendulum"},
    build=Build(kind="hybrid"),
    model=PartsSettings(
        encoder={"kind": "recurrent", "hidden": 8, "layers": [8]}, interaction={"kind": "mlp", "layers": [6, 6]}
    ),
    training=TrainSettings(epochs=3, batch_size=10, learning_rate=3e-3, checkpoint_s=0.0),
    t1_s=1.0,
    choices=resolve("corrected"),
    seeds=[0, 1],
    device="cpu",
)
PRIOR = {"omega0": [0.5, 3.5]}


def of_kind(kind: type[Kind], settings: Settings, /, **changes: object) -> Kind:
    """Settings of a kind with what others say that it knows, and changes; what was left out stays so."""
    shared = settings.model_fields_set & kind.model_fields.keys()
    return kind.of(**{name: getattr(settings, name) for name in shared} | changes)


def but(settings: Kind, /, **changes: object) -> Kind:
    """The same settings with some keys otherwise."""
    return of_kind(type(settings), settings, **changes)


@pytest.fixture
def settings():
    return SETTINGS


@pytest.fixture(scope="session")
def data(tmp_path_factory):
    return simulated(tmp_path_factory.mktemp("pendulum"), DATA)


def simulated(folder: Path, data: SimulatedData, system: SystemSettings | None = None) -> Path:
    """A folder with the sets that ``data`` describes, of pendulums or another system."""
    job = SimulateJob(system=system or PendulumSettings(), data=data)
    for name in data.sets:
        simulate(name, folder / f"{name}.npz", job)
    return folder


@pytest.fixture
def killed(monkeypatch):
    """Kills a training in its tenth step, the second of the third pass; then gives the steps that it takes after."""
    step, taken = Trainer.step, []

    def kill(train, *arguments):
        def counted(self, *args):
            if len(taken) == 9:
                raise KeyboardInterrupt
            taken.append(1)
            return step(self, *args)

        monkeypatch.setattr(Trainer, "step", counted)
        with pytest.raises(KeyboardInterrupt):
            train(*arguments)
        taken.clear()
        monkeypatch.setattr(Trainer, "step", lambda self, *args: taken.append(1) or step(self, *args))
        return taken

    return kill
