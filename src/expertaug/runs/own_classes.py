"""Whether the classes that a configuration names keep their contracts: all of them tried before hours of jobs find out.

Every system and every hybrid method of the run is made as in training, called on a few samples, and trained for a step.
"""

from __future__ import annotations

import inspect
import json
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from expertaug.config import jobs, stage_settings
from expertaug.config.jobs import foreign
from expertaug.config.models import Augmentation, Configuration
from expertaug.errors import InputError, InputErrors, SolveError
from expertaug.inference.settings import AlternateJob
from expertaug.learning.settings import TrainJob, TrainOptions, train_job_kind
from expertaug.models.estimators import Alternating, Hybrid
from expertaug.models.settings import SystemKeys
from expertaug.settings import read

if TYPE_CHECKING:
    from expertaug.learning.train import Calibration
    from expertaug.systems import System
    from expertaug.trajectories import Trajectories

SAMPLES = 4
PER_SEED = "lambda0"  # the option of an objective that may be a list of one value for each seed


def check_classes(config: Configuration, only_own: bool = False, device: bool = True) -> list[str]:
    """Try the systems and the hybrid methods of every experiment of the run.

    Arguments:
        config: completed, with the points of its grids.
        only_own: leave out what is the package's own; torch is loaded only where something is left.
        device: whether the run's device must be there: not where the jobs run elsewhere.

    Returns:
        a line for everything that was checked.

    Raises:
        InputErrors: everything that is wrong: a line each.
    """
    lines: list[str] = []
    wrong: dict[str, InputError] = {}
    for experiment in config.run:
        methods = [*config.experiments[experiment].methods, *config.experiments[experiment].points]
        methods = [m for m in methods if not only_own or foreign(config, experiment, m)]
        if methods:
            trial = _Experiment(config, experiment, methods)
            lines += trial.check(device)
            for error in trial.wrong:  # what is wrong with a class is told once, not for every method that has it
                text = str(error)
                wrong.setdefault(text.removeprefix(error.where) if ", " in error.where else text, error)
    if wrong:
        raise InputErrors(list(wrong.values()))
    return lines


@dataclass
class _Experiment:
    """An experiment that is being checked.

    Attributes:
        systems: those that were made, by their settings; None for one that is wrong.
    """

    config: Configuration
    name: str
    methods: list[str]
    wrong: list[InputError] = field(default_factory=list)
    systems: dict[str, System | None] = field(default_factory=dict)

    def check(self, device: bool) -> Iterator[str]:
        """What was checked, line by line; what is wrong is kept."""
        from expertaug.models.store import device_of

        if device:
            self._try("device", lambda: device_of(self.config.device))
        experiment = self.config.experiments[self.name]
        data = None
        if experiment.data.source == "simulation":
            system = self._system(experiment.system, simulated=True)
            if system is None:
                return
            yield f"{self.name}: system {type(system).__name__} checked"
            data = self._try(self._where("system", type(system)), lambda: self._simulated(system))
            if data is None:
                return
        for method in self.methods:
            if self._method(method, data):
                yield f"{self.name}: method {method} checked"

    def _system(self, settings: SystemKeys, simulated: bool = False) -> System | None:
        """A system that keeps its contract; None, and what is wrong is kept, for any other."""
        from expertaug import systems
        from expertaug.systems.check_system import check_system

        key = json.dumps(settings, sort_keys=True)
        if key in self.systems:
            return self.systems[key]
        count = len(self.wrong)
        system = self._try(f"experiments.{self.name}.system", lambda: systems.load(settings))
        if system is not None:
            where = self._where("system", type(system))
            z_e, z_a = (self._ranges(system, part, simulated) for part in ("z_e", "z_a"))
            if len(self.wrong) == count:
                step_s = self.config.experiments[self.name].data.step_s or 0.01
                self._try(where, lambda: check_system(system, where, z_e, z_a, simulated, step_s=step_s))
        self.systems[key] = system if len(self.wrong) == count else None
        return self.systems[key]

    def _ranges(self, system: System, part: str, simulated: bool) -> dict[str, list[float]] | None:
        """From the least to the largest value of each parameter over the sets and the priors, each checked."""
        from expertaug.systems.check_system import check_ranges

        experiment, where = self.config.experiments[self.name], f"experiments.{self.name}"
        ranges = {}
        if simulated:
            ranges |= {f"{where}.data.sets.{n}.{part}": getattr(s, part) for n, s in experiment.data.simulated.items()}
        if part == "z_e":
            priors: dict[str, Augmentation] = {"augmentation": experiment.augmentation}
            priors |= {f"augmentations.{name}": prior for name, prior in experiment.further_priors.items()}
            for method in self.methods:
                own = self.config.experiment_of(self.name, method).augmentation
                if own != experiment.augmentation:
                    priors[f"overrides.{method}.augmentation"] = own
            ranges |= {f"{where}.{key}.prior": a.prior for key, a in priors.items() if a.prior}
        parameters = getattr(system, "expert_parameters" if part == "z_e" else "interaction_parameters", ())
        name = type(system).__name__
        fits = [self._try(at, lambda: check_ranges(parameters, r, at, name) or True) for at, r in ranges.items()]  # noqa: B023
        if not fits or not all(fits):
            return None
        ends = {n: [r[n] for r in ranges.values() if n in r] for n in next(iter(ranges.values()))}
        return {n: [min(r[0] for r in intervals), max(r[1] for r in intervals)] for n, intervals in ends.items()}

    def _simulated(self, system: System) -> Trajectories:
        """A few samples of the training set."""
        from expertaug.systems.settings import SimulateJob
        from expertaug.systems.simulate import sample

        data = SimulateJob.from_mapping(stage_settings.simulate(self.config, self.name, "train")).data
        few = data.sets["train"].model_copy(update={"size": SAMPLES})
        return sample(system, data.model_copy(update={"sets": {"train": few}}), "train")

    def _method(self, method: str, data: Trajectories | None) -> bool:
        """Make a method's system and model as its training does, and try them; whether all is well."""
        from expertaug.learning.check_parts import check_parts
        from expertaug.learning.settings import objective_of
        from expertaug.learning.train import describe_recipe
        from expertaug.learning.trainer import make_objective
        from expertaug.models import describe

        group, seeds = next(iter(jobs.seed_groups(self.config, self.name).items()))
        job = stage_settings.train(self.config, self.name, method, group)
        stage = self.config.methods[method].estimator.stage
        settings = read(AlternateJob if stage == Alternating.stage else train_job_kind(job), job)
        calibrated = self.config.experiments[self.name].data.calibrate
        described = describe_recipe(settings, _stand_in() if calibrated else None)
        system = self._system(described.system)
        if system is None or not isinstance(settings, TrainJob):
            return system is not None
        objective = settings.build.objective_kind
        options = _for_two_seeds(settings, len(seeds))
        where = f"experiments.{self.name}, {method}"

        def parts() -> bool | None:
            recipe, kind = describe.recipe_of(system, described), objective_of(objective)
            parts = {"encoder": recipe.encoder, "interaction": recipe.interaction if described.interaction else None}
            classes = [_class_of(part, named["kind"]) for part, named in parts.items() if named is not None]
            at = self._where(method, *classes, kind)
            return self._try(at, lambda: tried(recipe, kind, at))

        def tried(recipe: Any, kind: Any, at: str) -> bool:
            task, samples = self._task(settings, data)
            check_parts(recipe, task, lambda s: make_objective(kind, s, options), samples, at)
            return True

        return bool(self._try(where, parts))

    def _task(self, settings: TrainOptions, data: Trajectories | None) -> tuple:
        """The task of a training, and samples, y (T, N, *state), where the data are simulated."""
        import torch

        from expertaug.learning.divergence import divergence_bound
        from expertaug.learning.train import observed_points
        from expertaug.learning.training_data import task_of
        from expertaug.models.card import ModelCard
        from expertaug.windows import Windows

        t = [float(v) for v in data.t] if data is not None else self._times()
        observed, bound = observed_points(t, settings.t1_s, settings.choices), None
        samples = None
        if data is not None:
            samples = Windows.of(data).seed(0)
            bound = divergence_bound(data.y)
        said = {
            "kind": Hybrid.name,
            "system": {"name": self.name},
            "seeds": settings.seeds,
            "t": t,
            "observed": observed,
        }
        card = ModelCard.of(**said, **({} if bound is None else {"bound": bound}))
        return task_of(settings.training, card, torch.device("cpu")), samples

    def _times(self) -> list[float]:
        """Times of a chunk of a recording, or about those of one of measurements, in s."""
        data = self.config.experiments[self.name].data
        if data.source == "files":
            step_s = data.files.step_s or data.t1_s / (data.files.length // 2)
            return [k * step_s for k in range(data.files.length)]
        assert data.split.rate_hz is not None  # completed
        return [k / data.split.rate_hz for k in range(data.split.length)]

    def _where(self, what: str, *classes: type) -> str:
        """A place for messages: the experiment and the files of classes from elsewhere."""
        files = dict.fromkeys(_file(c) for c in classes if not c.__module__.startswith("expertaug."))
        named = f" ({', '.join(files)})" if files else ""
        return f"experiments.{self.name}, {what}{named}"

    def _try(self, where: str, call: Callable) -> Any:
        """What a call gives; None where it fails, and the reason is kept as one line."""
        try:
            return call()
        except InputError as error:
            located = error.where == "device" or error.where.startswith("experiments.")
            self.wrong.append(error if located else InputError(where, str(error)))
        except SolveError as error:
            self.wrong.append(InputError(where, str(error), "narrow the ranges, or correct the class"))
        except Exception as error:  # a class from elsewhere may raise anything
            problem = f"fails ({type(error).__name__}: {error})"
            self.wrong.append(InputError(where, problem, "correct the class"))
        return None


def _class_of(part: str, kind: str) -> type:
    from expertaug import registry
    from expertaug.learning.settings import ALL_PARTS

    return registry.find(ALL_PARTS[part], kind, f"{part}.kind")


def _file(cls: type) -> str:
    try:
        file = inspect.getfile(cls)
        path = os.path.relpath(file)
        return file if path.startswith(os.pardir) else path
    except (TypeError, OSError, ValueError):  # made by hand, or on another drive
        return cls.__module__


def _for_two_seeds(settings: TrainJob, seeds: int) -> TrainJob:
    """A training of two seeds like one of ``seeds`` of them."""
    options = dict(settings.training.objective or {})
    if isinstance(options.get(PER_SEED), list | tuple) and len(options[PER_SEED]) == seeds:
        options[PER_SEED] = [*options[PER_SEED], *options[PER_SEED]][:2]
    training = settings.training.model_copy(update={"objective": options})
    return settings.model_copy(update={"training": training})


def _stand_in() -> Calibration:
    """What a calibration will give, stood in for by point masses on arms of the default lengths, without friction."""
    from expertaug.learning.train import Calibration
    from expertaug.systems.double_pendulum import point_masses
    from expertaug.systems.settings import DoublePendulumSettings

    default = DoublePendulumSettings()
    constants = point_masses(default.l1, default.l2).to_dict()
    return Calibration(constants, constants, (0.0, 0.0))
