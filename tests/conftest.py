"""For all tests: one thread a process, as the command line has it; set before any numerical library is loaded.

Its folders mirror those of ``src`` (``recordings`` is ``expertaug_recordings``); tests of more than one module have the
folder of what they are about.  All of them are on Python's path, so that tests of any room can name
``plain_parts:Class``.
"""

import functools
import gc
import os
import pickle
import sys
from collections.abc import Generator
from pathlib import Path

import pytest

sys.path[:0] = [str(folder) for folder in sorted(Path(__file__).parent.rglob("*")) if any(folder.glob("*.py"))]

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Garbage is looked for in what tests make, and not each time in the half a million objects of what is imported."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.collect()
        gc.freeze()
        gc.set_threshold(50_000, 20, 20)
        gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list) -> None:
    """Tests of the small run are slow, and come first: while it goes on, the other process has all others to do."""
    for item in items:
        if "smoke_run" in item.fixturenames and item.get_closest_marker("outside") is None:
            item.add_marker(pytest.mark.slow)
    items.sort(key=lambda item: "smoke_run" not in item.fixturenames)


@pytest.fixture(scope="session")
def empty_database(tmp_path_factory):
    """An MLflow database without anything in it, as MLflow's dozens of migrations make it for all test processes."""
    from filelock import FileLock

    root = tmp_path_factory.getbasetemp()
    root = root.parent if "PYTEST_XDIST_WORKER" in os.environ else root
    path, begun = root / "empty_mlflow.db", root / "begun_mlflow.db"
    with FileLock(root / "empty_mlflow.lock"):
        if not path.exists():
            from mlflow.store.db import utils
            from sqlalchemy import create_engine

            engine = create_engine(f"sqlite:///{begun}")
            utils._initialize_tables(engine)
            engine.dispose()
            begun.rename(path)
    return path


@pytest.fixture
def quick_stores(empty_database, monkeypatch):
    """New MLflow stores are copies of an empty one: the migrations take seconds each time."""
    import sqlite3

    def copy(engine) -> None:
        with sqlite3.connect(empty_database) as empty, sqlite3.connect(engine.url.database) as new:
            empty.backup(new)

    monkeypatch.setattr("mlflow.store.db.utils._initialize_tables", copy)


@pytest.fixture(scope="session", autouse=True)
def _each_yaml_text_is_parsed_once():
    """The same configurations are read hundreds of times; what is made of their nodes is made each time."""
    import yaml

    from expertaug.config import yaml_file

    @functools.cache
    def kept(text: str, loader: type) -> bytes:
        return pickle.dumps(yaml.compose(text, Loader=loader))

    class Composing:
        """The library as that module sees it."""

        @staticmethod
        def compose(text: str, Loader: type) -> object:
            return pickle.loads(kept(text, Loader))  # reading a tree changes it

        def __getattr__(self, name: str) -> object:
            return getattr(yaml, name)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(yaml_file, "yaml", Composing())
        yield
