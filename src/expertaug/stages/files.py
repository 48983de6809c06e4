"""The files of a run: where each stage's lie in the results folder, and which are on the way to others.

Only names: that a file is there is for the workflow to see to.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import PurePosixPath

from expertaug.config import jobs
from expertaug.config.models import Configuration
from expertaug.versions import MAIN_SETS, Version

LEARNING_SETS = ("train", "validation")


class Files:
    """The files of a configuration's run.

    Methods whose names begin with ``to_`` give files with everything that these are made from but recordings. A target
    of the workflow asks for all of it, since Snakemake does not see that a file on the way is missing if what was made
    of it is there (its issue 1978), as after a job that was stopped while it was redone, or when it was deleted.

    Arguments:
        config: completed.
    """

    def __init__(self, config: Configuration) -> None:
        self.config = config

    def path(self, path: str) -> str:
        """A path in the results folder."""
        return f"{self.config.results}/{path}"

    def seed_groups(self, experiment: str) -> list[str]:
        """Names of the groups of seeds."""
        return list(jobs.seed_groups(self.config, experiment))

    def compared(self, experiment: str) -> list[str]:
        """Versions that tables and figures show."""
        return jobs.variants(self.config, experiment)

    def variants(self, experiment: str) -> list[str]:
        """Every version that is evaluated: these, and those of the study of the prior's width."""
        return [*self.compared(experiment), *jobs.further_variants(self.config, experiment)]

    def methods(self, experiment: str) -> list[str]:
        """Methods that are trained, points of a grid aside."""
        return self.config.experiments[experiment].methods

    def logged(self, experiment: str) -> list[str]:
        """Versions that have a training's log: all but those that are computed at once."""
        kinds = {name: method.estimator for name, method in self.config.methods.items()}
        trained = [v for v in map(Version.parse, self.compared(experiment)) if v.is_trained]
        return [str(v) for v in trained if kinds[v.method].trains()]

    def augmented(self, experiment: str) -> list[str]:
        """Versions that are fine-tuned on augmented samples."""
        versions = map(Version.parse, self.variants(experiment))
        return [str(v) for v in versions if v.is_augmented and not v.estimators]

    def finetuned(self, experiment: str) -> list[str]:
        """These, and controls."""
        versions = map(Version.parse, self.compared(experiment))
        return [*self.augmented(experiment), *(str(v) for v in versions if v.is_control and v.is_trained)]

    def flows(self, experiment: str) -> list[str]:
        """Versions whose posterior a flow learns."""
        versions = map(Version.parse, self.variants(experiment))
        return [str(v) for v in versions if v.is_flow and v.is_trained]

    def followed(self, experiment: str) -> list[str]:
        """The method that the study along training follows, if any."""
        study = self.config.experiments[experiment].studies.during_training
        return [study.method] if study is not None else []

    def found_priors(self, experiment: str) -> list[str]:
        """Augmented versions whose p⁺ finds its ranges from a trained model."""
        return [v for v in jobs.list_found_priors(self.config, experiment) if v]

    def sets(self, experiment: str, names: Iterable[str]) -> list[str]:
        """Sets by name."""
        return [self.path(f"{experiment}/data/{name}.npz") for name in names]

    def of_versions(self, experiment: str, variants: Iterable[str], *files: str) -> list[str]:
        """Files of every group of seeds of versions of methods."""
        groups = self.seed_groups(experiment)
        return [self.path(f"{experiment}/{v}/{group}/{file}") for file in files for v in variants for group in groups]

    def model(self, experiment: str, version: object, seed_group: str) -> str:
        """The model file of a group of seeds."""
        return self.path(f"{experiment}/{version}/{seed_group}/model.safetensors")

    def augmented_samples(self, experiment: str, variant: str, seed_group: str) -> list[str]:
        """Those that a version is fine-tuned on; a control has none."""
        augmented = Version.parse(variant).is_augmented
        return [self.path(f"{experiment}/{variant}/{seed_group}/augmented.safetensors")] if augmented else []

    def calibration(self, experiment: str) -> list[str]:
        """The fitted constants of the expert, where it is to be calibrated."""
        calibrated = self.config.experiments[experiment].data.calibrate
        return [self.path(f"{experiment}/data/calibration.json")] if calibrated else []

    def prior(self, experiment: str, variant: str, seed_group: str) -> list[str]:
        """The ranges of a version's p⁺, where they are to be found."""
        kind = self.config.methods[Version.parse(variant).method].estimator
        finder = jobs.finds_prior(self.config, experiment, variant) if kind.has_expert else None
        if finder is None:
            return []
        folder = f"{finder}/{seed_group}" if finder else "data"
        return [self.path(f"{experiment}/{folder}/prior.json")]

    def prior_to_train(self, experiment: str, method: str) -> list[str]:
        """The same for the training of a method."""
        finds_prior = jobs.finds_prior_to_train(self.config, experiment, method)
        return [self.path(f"{experiment}/data/prior.json")] if finds_prior else []

    def sets_to_cover(self, experiment: str, variant: str = "") -> list[str]:
        """The training set, and those whose observed windows p⁺ of a version is to cover; of none before training."""
        version = Version.parse(variant)
        block = self.config.experiment_of(experiment, version.method or None).augmentation_of(version.prior)
        return self.sets(experiment, ["train", *block.windows])

    def before_training(self, experiment: str, variants: Iterable[str]) -> list[str]:
        """What the methods of versions are trained on."""
        own = _methods(variants)
        if not own:
            return []
        priors = [file for method in own for file in self.prior_to_train(experiment, method)]
        covered = self.sets_to_cover(experiment) if priors else []
        data = [*self.sets(experiment, LEARNING_SETS), *self.calibration(experiment), *covered, *priors]
        return [*data, self.path("mlflow/tracking.json")]

    def to_trainings(self, experiment: str, variants: Iterable[str]) -> list[str]:
        """Model files of the versions' methods as trained."""
        models = self.of_versions(experiment, _methods(variants), "model.safetensors")
        return [*self.before_training(experiment, variants), *models]

    def to_priors(self, experiment: str, variants: Iterable[str]) -> list[str]:
        """The ranges that p⁺ of versions have found from trained models."""
        files = []
        for variant in variants:
            for group in self.seed_groups(experiment):
                if prior := self.prior(experiment, variant, group):
                    finder = jobs.finds_prior(self.config, experiment, variant) or ""
                    files += [*self.sets_to_cover(experiment, finder), *prior]
        return [*self.to_trainings(experiment, variants), *files]

    def to_augmented(self, experiment: str, variants: Iterable[str]) -> list[str]:
        """Augmented samples of those versions that are fine-tuned on such."""
        augmented = [v for v in map(Version.parse, variants) if v.is_augmented and not v.is_flow]
        samples = self.of_versions(experiment, [str(v.trained) for v in augmented], "augmented.safetensors")
        return [*self.to_priors(experiment, variants), *samples]

    def to_models(self, experiment: str, variants: Iterable[str]) -> list[str]:
        """Model files of versions."""
        trained = dict.fromkeys(str(Version.parse(v).trained) for v in variants)
        models = self.of_versions(experiment, trained, "model.safetensors")
        return [*self.to_augmented(experiment, variants), *models]

    def to_scores(self, experiment: str, variants: Iterable[str]) -> list[str]:
        """Metrics and forecasts of versions."""
        scores = self.of_versions(experiment, variants, "metrics.csv", "forecasts.npz")
        sets = self.sets(experiment, self.config.experiments[experiment].data.set_names) if scores else []
        return [*sets, *self.to_models(experiment, variants), *scores]

    def to_stages_of_training(self, experiment: str) -> list[str]:
        """Scores of models along a training, where there is that study."""
        followed = self.followed(experiment)
        if not followed:
            return []
        scores = self.of_versions(experiment, followed, "snapshots.safetensors", "during_training.csv")
        priors = self.to_priors(experiment, [f"{method}+" for method in followed])
        return [*self.sets(experiment, MAIN_SETS), *priors, *scores]

    def to_files(self, experiment: str, files: Iterable[str]) -> list[str]:
        """Files of versions, as a study reads them."""
        parts = [PurePosixPath(file).parts[-3:] for file in files]
        variants = list(dict.fromkeys(variant for variant, _, name in parts if variant != experiment))
        named = {name for *_, name in parts}
        needed = [*self.to_stages_of_training(experiment)] if "during_training.csv" in named else []
        for name, before in {
            "model.safetensors": self.to_models,
            "prior.json": self.to_priors,
            "metrics.csv": self.to_scores,
            "forecasts.npz": self.to_scores,
        }.items():
            needed += before(experiment, variants) if name in named else []
        return [*needed, *files]


def _methods(variants: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(Version.parse(v).method for v in variants))
