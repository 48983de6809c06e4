"""What a user brings lies outside of the results folder."""

from __future__ import annotations

import pytest

from expertaug.config.models import Configuration
from expertaug.config.sources import refuse_within_results
from expertaug.errors import InputError
from expertaug_recordings.settings import RecordingKeys


def config(results, source="videos", path="videos", checksums=None):
    own = {} if source == "rendered" else {source: {"path": path}}
    recordings = RecordingKeys.of(source=source, checksums=checksums, **own)
    return Configuration.model_construct(results=str(results), recordings=recordings)


@pytest.fixture
def results(tmp_path):
    (tmp_path / "results" / "mine").mkdir(parents=True)
    (tmp_path / "results" / "mine" / "a.mp4").touch()
    return tmp_path / "results"


def test_recordings_elsewhere_are_taken(results, tmp_path):
    (tmp_path / "a.mp4").touch()
    refuse_within_results(config(results), {"a": str(tmp_path / "a.mp4")})
    refuse_within_results(config(results, "rendered"), {"rendered_00": 0})
    refuse_within_results(config(results, path=str(results / "mine")), {})  # no experiment of the run takes recordings


def test_recordings_in_the_results_folder_are_refused_in_one_line(results, tmp_path, monkeypatch):
    with pytest.raises(
        InputError, match=r"^recordings\.videos\.path: '.*a\.mp4' lies in the results folder .*; move it"
    ):
        refuse_within_results(config(results), {"a": str(results / "mine" / "a.mp4")})
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="results folder 'results'"):
        refuse_within_results(config("results"), {"a": "results/mine/../mine/a.mp4"})


def test_a_link_hides_nothing(results, tmp_path):
    (tmp_path / "link.mp4").symlink_to(results / "mine" / "a.mp4")
    (results / "out.mp4").symlink_to(tmp_path / "b.mp4")
    for path in (tmp_path / "link.mp4", results / "out.mp4"):
        with pytest.raises(InputError, match="results folder"):
            refuse_within_results(config(results), {"a": str(path)})


def test_an_archive_and_checksums_in_the_results_folder_are_refused(results):
    with pytest.raises(InputError, match=r"^recordings\.markers\.path: "):
        refuse_within_results(config(results, "markers", str(results / "markers.tar.gz")), None)
    with pytest.raises(InputError, match=r"^recordings\.checksums: "):
        refuse_within_results(config(results, "rendered", checksums=str(results / "SHA256SUMS")), {"rendered_00": 0})
