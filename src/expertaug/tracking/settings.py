"""Which MLflow store mirrors the logs."""

from __future__ import annotations

from typing import ClassVar

from expertaug.settings import Settings, key


class InitTrackingJob(Settings):
    """The stage init_tracking: the store that is to be made or upgraded."""

    WHERE: ClassVar[str] = "--settings"

    enabled: bool = key(..., "whether there is one")
    uri: str = key(..., "of the store")
    experiment: str = key(..., "name of the MLflow experiment")


class Tracking(InitTrackingJob):
    """The store that a job logs to, as init_tracking found it."""

    experiment_id: str | None = key(None, "of the MLflow experiment; null = the store could not be used")
    rule: str | None = key(None, "that logs")
