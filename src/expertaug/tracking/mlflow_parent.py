"""The parent run of a method: what its seeds amount to, mean and spread, and the worst of their states."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

WORST_FIRST = ("FAILED", "KILLED", "RUNNING", "SCHEDULED")
SPREAD = " sd"  # of a metric's name: its standard deviation over seeds
NOTE = f"""Each metric is the mean of the last values of this method's runs below, over {{count}} seeds;
`NAME{SPREAD}` is their standard deviation. Logarithms are natural and of mean squared errors, `rmse_NAME` has the unit
of NAME, `relative_error` is in percent. The table with these numbers is `{{table}}` in the results folder.
"""


class Parent:
    """The run above the runs of a method's seeds.

    Arguments:
        client, experiment_id: of the store.
        run_id: of the parent.
        header: the first line of a run log below it.
    """

    def __init__(self, client: Any, experiment_id: str, run_id: str, header: Mapping[str, Any]) -> None:
        self._client, self._experiment_id, self.run_id = client, experiment_id, run_id
        self._table = f"tables/{header['experiment']}.md"

    def end(self, stage: str, end: int) -> None:
        """A log of a stage has ended, at ``end`` in ms: the parent gets that stage's values, and a state."""
        children = self._children()
        self._log_metrics([run for run in children if run.data.tags.get("stage") == stage], end)
        states = {run.info.status for run in children}
        worst = next((state for state in WORST_FIRST if state in states), "FINISHED")
        if worst == "RUNNING":
            self._client.update_run(self.run_id, status=worst)
        elif worst != "FINISHED" or (self._client.get_run(self.run_id).info.end_time or 0) < end:
            self._client.set_terminated(self.run_id, worst, end_time=end)

    def _children(self) -> list[Any]:
        """Runs of this method that no later one has replaced."""
        found, page = [], None
        condition = f"tags.mlflow.parentRunId = '{self.run_id}'"
        while page is None or page.token:
            page = self._client.search_runs([self._experiment_id], condition, page_token=page and page.token)
            found += [run for run in page if run.data.tags.get("expertaug.superseded") != "true"]
        return found

    def _log_metrics(self, runs: list[Any], end: int) -> None:
        from mlflow.entities import Metric

        metrics = []
        for name in sorted({name for run in runs for name in run.data.metrics}):
            values = [run.data.metrics[name] for run in runs if name in run.data.metrics]
            metrics.append(Metric(name, float(np.mean(values)), end, 0))
            if len(values) > 1:
                metrics.append(Metric(f"{name}{SPREAD}", float(np.std(values, ddof=1)), end, 0))
        for start in range(0, len(metrics), 1000):
            self._client.log_batch(self.run_id, metrics=metrics[start : start + 1000])
        note = NOTE.format(count=len(runs), table=self._table)
        self._client.set_tag(self.run_id, "mlflow.note.content", note)
