"""Where the runs behind a table's rows are found in the dashboard."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from expertaug.evaluation.summary import TabledMean, labels_of
from expertaug.evaluation.table import Table
from expertaug.tracking.settings import Tracking

Links = Mapping[tuple[str, str], str]  # addresses by a table's part and the name of a row


@dataclass(frozen=True)
class Dashboard:
    """The dashboard of a run.

    Attributes:
        tracking: the store that it shows; None where the run has none.
    """

    tracking: Tracking | None

    @property
    def command(self) -> str | None:
        """What serves it; None where a server does, or there is none."""
        return None if self.tracking is None else self.tracking.command

    def of(self, table: Table, experiment: str, long: Sequence[TabledMean]) -> Links:
        """The runs of each version that has rows in a table of one experiment.

        Arguments:
            long: the experiment's long table.
        """
        methods = {label: method for method, label in labels_of(long).items()}
        rows = [(part, str(row[0])) for part, rows in table.html_parts for row in rows]
        links = {(part, label): self._runs(experiment, methods.get(label)) for part, label in rows}
        return {place: link for place, link in links.items() if link is not None}

    def of_several(self, table: Table, longs: Mapping[str, tuple[str, Sequence[TabledMean]]]) -> Links:
        """The same of a table with a part for each experiment.

        Arguments:
            longs: name and long table of an experiment by its part of the table.
        """
        links: dict[tuple[str, str], str] = {}
        for part, (experiment, long) in longs.items():
            links |= {place: link for place, link in self.of(table, experiment, long).items() if place[0] == part}
        return links

    def _runs(self, experiment: str, method: str | None) -> str | None:
        """The list of a version's runs: a search, which also finds those of a store that was made anew."""
        if self.tracking is None or method is None:
            return None
        return self.tracking.page_of(experiment, f"tags.method = '{method}'")
