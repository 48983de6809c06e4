"""Classes named by a configuration, and what they take."""

import sys

import pytest

from expertaug import registry, systems
from expertaug.errors import InputError
from expertaug.learning.settings import ALL_PARTS

MODULE = """
from abc import abstractmethod, ABC
from torch import nn
from expertaug.learning.objectives import Aphynity, Objective

class Base(nn.Module):
    def __init__(self, system, times, width=3, *, depth=1):
        super().__init__()
    def forward(self, observed): ...

class Inherited(Base): ...

class HandsOn(Base):
    def __init__(self, gain=1.0, **options):
        super().__init__(**options)

class Anything(nn.Module):
    def __init__(self, system, **options):
        super().__init__()
    def forward(self, observed): ...

class Nothing(nn.Module):
    def forward(self, observed): ...

class Recurrent(nn.GRU): ...

class Without(nn.Module): ...

class Abstract(Base, ABC):
    @abstractmethod
    def head(self): ...

class Bare(Objective): ...

class Scaled(Aphynity):
    def __init__(self, seeds, choices, factor=1.0, **carried):
        super().__init__(seeds, choices, **carried)

def function(): ...
"""


@pytest.fixture(autouse=True)
def module(tmp_path, monkeypatch):
    (tmp_path / "owned.py").write_text(MODULE)
    (tmp_path / "broken.py").write_text("import torch\nraise ValueError('at import')\n")
    (tmp_path / "needy.py").write_text("import no_such_library\n")
    (tmp_path / "wrong.py").write_text("class X(:\n")
    monkeypatch.syspath_prepend(tmp_path)
    yield
    import sys

    for name in ("owned", "broken", "needy", "wrong"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize(
    ("part", "name", "expected"),
    [
        ("encoder", "Base", ["width", "depth"]),
        ("encoder", "Inherited", ["width", "depth"]),
        ("encoder", "HandsOn", ["gain", "width", "depth"]),
        ("encoder", "Anything", None),
        ("encoder", "Nothing", []),
        ("objective", "Scaled", ["factor", "lambda0", "tau2", "every", "share"]),
    ],
)
def test_options_are_read_through_inheritance_and_keywords(part, name, expected):
    found = registry.arguments(registry.find(ALL_PARTS[part], f"owned:{name}", "here"))
    assert found is None if expected is None else [a for a in found if a not in ALL_PARTS[part].given] == expected


def test_options_of_a_class_of_torch():
    cls = registry.find(ALL_PARTS["encoder"], "owned:Recurrent", "here")
    assert {"input_size", "hidden_size"} <= set(registry.arguments(cls))


def test_every_kind_of_the_package_can_be_asked():
    for part in ALL_PARTS.values():
        for kind in part.kinds:
            assert registry.arguments(registry.find(part, kind, "here")) is not None


@pytest.mark.parametrize(
    ("part", "kind", "expected"),
    [
        ("encoder", "cnn", r"here: 'cnn' is no encoder; known: window, recurrent"),
        ("encoder", "recurent", r"here: 'recurent' is no encoder; did you mean 'recurrent'\? known: window"),
        ("encoder", ["a:b"], r"here: \['a:b'\] is no encoder"),
        ("encoder", "no.such:X", r"here: no module 'no\.such'"),
        ("encoder", "torch.nothing:X", r"here: no module 'torch\.nothing'"),
        ("encoder", "needy:X", r"here: needy imports 'no_such_library', which is not there; install it"),
        ("encoder", "broken:X", r"here: broken cannot be imported \(ValueError: at import\)"),
        ("encoder", "wrong:X", r"wrong\.py:1: no Python"),
        ("encoder", "owned:Missing", r"here: no class 'Missing' in owned"),
        ("encoder", "os:system", r"here: 'system' is no class; name a subclass of torch\.nn\.Module"),
        ("encoder", "owned:Bare", r"here: the class Bare is no Module; make it a subclass of torch\.nn\.Module"),
        ("interaction", "owned:Without", r"here: the class Without does not define forward"),
        ("encoder", "owned:Abstract", r"here: the class Abstract is abstract; define head"),
        ("objective", "owned:Base", r"here: the class Base is no Objective"),
        ("objective", "owned:Bare", r"here: the class Bare does not define loss; every objective needs it"),
    ],
)
def test_what_cannot_be_used_is_one_line(part, kind, expected):
    with pytest.raises(InputError, match=expected):
        registry.find(ALL_PARTS[part], kind, "here")


def test_a_module_of_this_folder_is_told_how_to_be_found(tmp_path, monkeypatch):
    (tmp_path / "mine_here.py").write_text("from expertaug.systems.base import System\n\n\nclass Mine(System): ...\n")
    monkeypatch.chdir(tmp_path)
    before = list(sys.path)
    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if entry not in ("", str(tmp_path))])
    with pytest.raises(InputError, match=r"mine_here lies in this folder.*export PYTHONPATH=\$PWD"):
        systems.load({"name": "mine_here:Mine"})
    with pytest.raises(InputError, match=r"no system 'mine_here'; for mine_here\.py .* write .* mine_here:CLASS"):
        systems.load({"name": "mine_here"})
    monkeypatch.setattr(sys, "path", before)
    with pytest.raises(InputError, match=r"give mine_here:Mine for a class of mine_here"):
        systems.load({"name": "mine_here.Mine"})
