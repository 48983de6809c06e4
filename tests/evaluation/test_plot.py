"""The figures of an experiment: one of each name, of what its job says."""

from __future__ import annotations

from expertaug.evaluation import plot
from expertaug.evaluation.settings import PlotJob


def test_there_is_a_figure_of_each_name_and_it_shows_what_the_job_traces(monkeypatch):
    told = {}

    def drawing(name):
        return lambda *given: told.update({name: given}) or name

    for module, names in ((plot.dots, ("log_mse", "parameter_errors")), (plot.traces, ("forecasts", "curves"))):
        for name in names:
            monkeypatch.setattr(module, name, drawing(name))
    monkeypatch.setattr(plot, "parameters", drawing("parameters"))
    rows, forecasts, logs = [object()], {"a": object()}, [object()]
    job = PlotJob(labels=[("a", "A"), ("b", "B")], traced=["a"], measured=True)
    made = plot.plot(rows, forecasts, logs, job)
    assert made == {name: name for name in plot.NAMES} and list(made) == plot.NAMES
    assert told["log_mse"] == told["parameter_errors"] == (rows, job) and told["parameters"] == (forecasts, job)
    assert told["forecasts"][:2] == (forecasts, job) and told["forecasts"][2].measured
    assert told["curves"] == (logs, job, ["a"])
