"""What a study is: a stage that answers a question about an experiment's models with a table and, mostly, a figure."""

from __future__ import annotations

import argparse
import importlib
from typing import TYPE_CHECKING, Any, ClassVar

from expertaug.stages.stage import Stage

if TYPE_CHECKING:
    from expertaug.evaluation.products import Product
    from expertaug.stages.files import Files


class StudyStage(Stage):
    """A stage that makes a study. The workflow has one rule for all of them (``workflow/rules/studies.smk``).

    Attributes:
        paths: options of its command that ``run_stage`` of its module takes before the outputs and the job.
        product: name of its table and figure; empty for the stage's own.
        draws: whether there is a figure.
        title: that reports show; empty for the study's name.
        runs_models: whether it runs models on the sets: on the card if there is one, and its cost is measured.
        memory_mb: that its jobs ask for.
        log: where its log and its cost lie in their folders.
    """

    paths: ClassVar[tuple[str, ...]] = ()
    product: ClassVar[str] = ""
    draws: ClassVar[bool] = True
    title: ClassVar[str] = ""
    runs_models: ClassVar[bool] = False
    memory_mb: ClassVar[int] = 1000
    log: ClassVar[str] = "study/{experiment}_{study}"

    @classmethod
    def run(cls, a: argparse.Namespace, job: Any) -> None:
        """Read, call, write: what ``run_stage`` of its module does."""
        importlib.import_module(cls.code).run_stage(*(getattr(a, name) for name in cls.paths), a.output, job)

    @classmethod
    def products(cls) -> tuple[Product, ...]:
        from expertaug.evaluation.products import Product

        return (Product(cls.product or cls.key(), table=True, figure=cls.draws),)

    @classmethod
    def inputs(cls, files: Files, experiment: str, study: str) -> list[str]:
        """Files that it reads; none where the experiment has no such study.

        Arguments:
            files: of the run.
            study: name of its table and figure.
        """
        raise NotImplementedError

    @classmethod
    def sets(cls, files: Files, experiment: str) -> list[str]:
        """Files of the sets that it runs models on."""
        return []

    @classmethod
    def names(cls, experiment: str, study: str) -> tuple[str, ...]:
        """What its slice takes beside the configuration."""
        return (experiment,)
