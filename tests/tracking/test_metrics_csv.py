"""The long table of an evaluation: one number a seed, and the log that can be made of it alone."""

from __future__ import annotations

import math

import pytest

from expertaug.errors import InputError
from expertaug.tracking.metrics_csv import log_of_table, metrics_by_seed, read_rows

HEADER = "experiment,system,method,label,preset,seed,set,metric,value"


@pytest.fixture
def table(tmp_path):
    rows = [(1, "log_mse", "2.5"), (0, "log_mse", ""), (1, "rmse", "0.25"), (0, "rmse", "4.0")]
    text = [f"swing,pendulum,hybrid+,Hybrid+,corrected,{seed},test,{metric},{value}" for seed, metric, value in rows]
    path = tmp_path / "metrics.csv"
    path.write_text("\n".join([HEADER, *text]) + "\n")
    return path


def test_a_metric_is_one_number_a_seed_in_the_order_that_is_asked_for(table):
    found = metrics_by_seed(table, [0, 1])
    assert found["test/rmse"] == [4.0, 0.25]
    assert math.isnan(found["test/log_mse"][0]) and found["test/log_mse"][1] == 2.5, "an empty value is none"


def test_a_metric_that_lacks_a_seed_is_told(table):
    with pytest.raises(InputError, match=r"test/log_mse has seeds \[0, 1\]; one row for each of \[0, 1, 2\]"):
        metrics_by_seed(table, [0, 1, 2])


def test_a_table_alone_makes_the_log_that_its_evaluation_would_have_written(table):
    log = log_of_table(table)
    assert (log.header.experiment, log.header.method, log.header.stage) == ("swing", "hybrid+", "evaluate")
    assert log.header.seeds == (1, 0) and log.steps[0].metrics["test/rmse"] == (0.25, 4.0)
    assert log.lines[-1].status == "FINISHED" and log.header.id == log_of_table(table).header.id


def test_a_table_of_a_study_along_a_training_has_its_columns(table):
    with pytest.raises(InputError, match="no column 'epoch'"):
        read_rows(table, along=True)
    lines = table.read_text().splitlines()
    table.write_text("\n".join([f"{lines[0]},epoch,finetune_epochs", *(f"{line},3,1" for line in lines[1:])]) + "\n")
    assert {(row.epoch, row.finetune_epochs) for row in read_rows(table, along=True)} == {(3, 1)}
