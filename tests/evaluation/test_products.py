"""The files that stages make for readers, and the functions that studies name."""

from __future__ import annotations

from expertaug.evaluation import studies
from expertaug.evaluation.products import STUDIES, Product


def test_files_are_called_by_experiment_and_name_or_by_the_name_alone_where_they_are_of_all():
    own = Product("", table=True)
    assert list(own.files("swing")) == ["tables/swing.csv", "tables/swing.md", "tables/swing.tex"]
    both = Product("alarm", table=True, figure=True)
    assert list(both.files("swing", ("png",)))[2:] == ["tables/swing_alarm.tex", "figures/swing_alarm.png"]
    of_all = Product("log_mse", figure=True, of_all=True)
    assert list(of_all.files("swing")) == ["figures/log_mse.png", "figures/log_mse.pdf"]


def test_every_study_names_functions_that_there_are():
    for study in STUDIES:
        assert callable(getattr(studies, study.rows)) and callable(getattr(studies, study.draw)), study.name
        assert len(list(study.files("swing"))) == 5, "a table and a figure"
