"""Which MLflow store mirrors the logs."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import ClassVar
from urllib.parse import quote

from expertaug.errors import InputError
from expertaug.files import is_inside, read_json
from expertaug.settings import Settings, key, read

VIEW = "scores"  # of an experiment's runs: the columns that matter
MARKER = "mlflow/tracking.json"  # in a results folder


class Store(Settings):
    """An MLflow store: an MLflow experiment in it for each experiment of the configuration."""

    WHERE: ClassVar[str] = "--settings"

    enabled: bool = key(..., "whether there is one")
    uri: str = key(..., "of the store")
    experiment: str = key(..., "what names of MLflow experiments begin with")

    def name_of(self, experiment: str) -> str:
        """The MLflow experiment of a configuration's."""
        return f"{self.experiment} {experiment}"


class InitTrackingJob(Store):
    """The stage init_tracking: the store that is to be made or upgraded."""

    experiments: list[str] = key(..., "of the configuration")


class Tracking(Store):
    """The store that a job logs to, as init_tracking found it."""

    experiments: dict[str, str] | None = key(
        None, "ids of MLflow experiments by the configuration's; null = the store could not be used"
    )
    rule: str | None = key(None, "that logs")

    @property
    def address(self) -> str:
        """Where its dashboard is opened: a server's own address, else where ``mlflow server`` serves it."""
        return self.uri.rstrip("/") if self.uri.startswith("http") else "http://127.0.0.1:5000"

    @property
    def command(self) -> str | None:
        """What serves its dashboard; None where it is a server's."""
        served = self.uri.startswith("http")
        return None if served else f"mlflow server --backend-store-uri {shlex.quote(self.uri)}"

    def page_of(self, experiment: str, condition: str = "") -> str | None:
        """The address of an experiment's list of runs; None where the store has none.

        Arguments:
            condition: that they fulfil, as MLflow searches.
        """
        number = (self.experiments or {}).get(experiment)
        if number is None:
            return None
        shown = f"searchFilter={quote(condition)}" if condition else f"viewStateShareKey={VIEW}"
        # Without the type of workflow, MLflow opens an experiment as one of prompts and traces, which has no runs.
        return f"{self.address}/#/experiments/{number}/runs?workflowType=machine_learning&{shown}"


def tracking_of_run(results: str | Path) -> Tracking | None:
    """The store of a results folder; None where none is used, or nothing says which."""
    marker = Path(results) / MARKER
    if not marker.is_file() or not is_inside(marker, results):
        return None
    try:
        content = read_json(marker)
        return (
            read(Tracking, content, str(marker))
            if isinstance(content, dict) and content.get("enabled") is True
            else None
        )
    except InputError:
        return None
