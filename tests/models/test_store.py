"""Model files: what they hold, and what is refused."""

import json
import sys

import pytest
import torch
from safetensors.torch import save_file

from expertaug.errors import InputError
from expertaug.inference.settings import AlternatingSettings
from expertaug.models import store
from expertaug.models.card import TrainingRecord
from expertaug.models.tensor_file import DIGEST, HEADER, _digest, read_tensors
from expertaug.systems.settings import SolverSettings
from expertaug.systems.solvers.solver import Solver
from model_files import CARD, PENDULUM, write

DESCRIPTION = CARD.dump()
OWN = """
import expertaug.models.encoders.recurrent
import expertaug.systems.pendulum
from pathlib import Path

Path(__file__).with_name("imported").touch()


class Pendulum(expertaug.systems.pendulum.DampedPendulum):
    def __init__(self, length: float = 1.0) -> None:
        self.length = length


class Encoder(expertaug.models.encoders.recurrent.RecurrentEncoder):
    stackable = True
"""


def forged(path, header):
    """A file whose digest is right, as whoever forges one can make it."""
    _, tensors = read_tensors(path)
    text = header if isinstance(header, str) else json.dumps(header)
    save_file(tensors, path, metadata={HEADER: text, DIGEST: _digest(text, tensors)})


def test_it_holds_times_units_and_solver(tmp_path):
    write(tmp_path / "m", forecast_solver=store.forecast_solver(Solver("lawson4"), PENDULUM))
    stored = store.load(tmp_path / "m")
    assert stored.card.t[:4] == CARD.t[:4] and stored.seeds == [3, 4]
    assert stored.card.state == [["theta", "rad"], ["omega", "rad/s"]]
    assert stored.card.expert_parameters == [["omega0", "rad/s"]]
    assert stored.solver == Solver("lawson4")
    assert store.forecast_solver(None, PENDULUM) == store.ACCURATE
    assert store.forecast_solver(Solver("rk4"), PENDULUM) == store.ACCURATE
    assert store.forecast_solver(Solver("dopri8"), PENDULUM).method == "dopri8"


def test_a_file_without_a_digest_is_refused(tmp_path):
    save_file({"a": torch.zeros(1)}, tmp_path / "m", metadata={HEADER: json.dumps(DESCRIPTION)})
    with pytest.raises(InputError, match=r"damaged, or of an earlier version.; make it again"):
        store.load(tmp_path / "m")


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        ("[1]", "its header is no mapping"),
        ("[" * 100_000 + "]" * 100_000, "not a file of this package"),
        ("{", "not a file of this package"),
        ("{}", "describes no model"),
        (DESCRIPTION | {"kind": "other"}, "describes no model .*kind: found 'other'"),
        (DESCRIPTION | {"t": "abc"}, "describes no model"),
        (DESCRIPTION | {"t": [0, 0, 1, 2]}, "t: does not increase"),
        (DESCRIPTION | {"observed": 99}, "observed: found 99"),
        (DESCRIPTION | {"observed": [1]}, "describes no model"),
        (DESCRIPTION | {"seeds": []}, "describes no model"),
        (DESCRIPTION | {"seeds": [0, 1, 2]}, "it describes 3 seeds"),
        (DESCRIPTION | {"seeds": list(range(200_000))}, "describes no model .*seeds"),
        (DESCRIPTION | {"obsrved_s": 1.0}, "describes no model .*obsrved_s: unknown key; did you mean 'observed_s'?"),
        (DESCRIPTION | {"system": 3}, "describes no model"),
        (DESCRIPTION | {"model": {"encoder": 3}}, "describes no model"),
        (DESCRIPTION | {"model": DESCRIPTION["model"] | {"encoder": {"kind": "recurrent", "hidden": -1}}}, "no model"),
        (
            DESCRIPTION | {"model": DESCRIPTION["model"] | {"encoder": {"kind": "recurrent", "hidden": 3}}},
            "other layers",
        ),
        (
            DESCRIPTION | {"training": {"supervision_wieght": 1.0}},
            "training.supervision_wieght: .*did you mean 'supervision_weight'",
        ),
        (DESCRIPTION | {"state": [["x", "m"]]}, "was made with state .*the system now has .*theta"),
    ],
)
def test_a_header_that_makes_no_model_is_one_line(tmp_path, header, expected):
    path = tmp_path / "m"
    write(path)
    forged(path, header)
    with pytest.raises(InputError, match=expected) as caught:
        store.load(path)
    assert "\n" not in str(caught.value)


def test_what_stands_beside_a_model_has_the_record_of_its_training(tmp_path):
    base = DESCRIPTION | {"kind": "alternating", "training": AlternatingSettings(train_samples=40).to_json()}
    beside = base | {"kind": "flow", "flow": {}, "prior": {}, "noise": 0.1, "base": base}
    assert store.card_of(tmp_path / "m", beside).training.model_extra["train_samples"] == 40
    with pytest.raises(InputError, match=r"training\.train_samples: 'train_samples' is no setting of it"):
        store.card_of(tmp_path / "m", DESCRIPTION | {"training": {"train_samples": 40}})


def other_values(value):
    """What a forger may write instead of a value."""
    yield from (None, [], {}, "", -1, 1e30, True, [None], [[1]], {"a": 1})
    if isinstance(value, list) and value:
        yield from (value[:1], value + value[:1], [str(v) for v in value], list(range(40)))
    if isinstance(value, dict):
        yield from ({k: v for k, v in value.items() if k != lost} for lost in value)
        for key, inner in value.items():
            yield from (value | {key: other} for other in other_values(inner))


def test_whatever_a_forged_header_says_is_a_model_or_one_line_with_the_files_name(tmp_path):
    path = tmp_path / "m"
    training = TrainingRecord(solver=SolverSettings(method="rk4"))
    write(path, bound=[3.0, 3.0], training=training, failed=[3])
    header, tensors = read_tensors(path)
    refused = 0
    for key, value in header.items():
        for other in other_values(value):
            text = json.dumps(header | {key: other})
            save_file(tensors, path, metadata={HEADER: text, DIGEST: _digest(text, tensors)})
            try:
                stored = store.load(path)
            except InputError as error:
                refused += 1
                assert str(error).startswith(str(path)) and "\n" not in str(error)
            else:
                assert stored.seeds == [3, 4] or len(stored.seeds) == 2
    assert refused > 100


def test_a_weight_that_is_no_number_is_refused_with_the_files_name(tmp_path):
    model = write(tmp_path / "m")
    with torch.no_grad():
        next(model.parameters()).view(-1)[0] = torch.nan
    store.save(tmp_path / "m", model, CARD)
    with pytest.raises(InputError, match=r"/m: the tensor encoder\..* has values that are no numbers; train it again"):
        store.load(tmp_path / "m")


class TestClassesFromElsewhere:
    @pytest.fixture
    def own(self, tmp_path, monkeypatch):
        (tmp_path / "elsewhere_of_test").mkdir()
        (tmp_path / "elsewhere_of_test/parts.py").write_text(OWN)
        monkeypatch.syspath_prepend(tmp_path)
        yield "elsewhere_of_test.parts"
        for name in ("elsewhere_of_test", "elsewhere_of_test.parts"):
            sys.modules.pop(name, None)

    @pytest.mark.parametrize(
        "change",
        [
            {"system": {"name": "elsewhere_of_test.parts"}},
            {"system": {"name": "elsewhere_of_test.parts:Pendulum"}},
            {"system": {"name": "os.path"}},
            {"system": {"name": "expertaug.cli"}},
            {"model": DESCRIPTION["model"] | {"encoder": {"kind": "elsewhere_of_test.parts:Encoder", "hidden": 2}}},
            {"model": DESCRIPTION["model"] | {"interaction": {"kind": "expertaug.cli:main"}}},
            {"objective": "elsewhere_of_test.parts:Encoder"},
        ],
    )
    def test_are_not_imported_unless_named(self, own, tmp_path, change):
        write(tmp_path / "m", **change)
        with pytest.raises(InputError, match=r"needs .*, which is not part of expertaug; if you trust it: classes=\['"):
            store.load(tmp_path / "m")
        assert not (tmp_path / "elsewhere_of_test/imported").exists()

    @pytest.mark.parametrize("name", ["elsewhere_of_test.parts", "elsewhere_of_test.parts:Pendulum"])
    def test_are_used_when_named_or_given(self, own, tmp_path, name):
        encoder = {"kind": "elsewhere_of_test.parts:Encoder", "hidden": 2, "layers": [2]}
        change = {"system": {"name": name, "length": 2.0}, "model": DESCRIPTION["model"] | {"encoder": encoder}}
        write(tmp_path / "m", **change)
        with pytest.raises(InputError, match=r"elsewhere_of_test\.parts:Encoder"):
            store.load(tmp_path / "m", classes=[name])
        assert store.load(tmp_path / "m", classes=[name, "elsewhere_of_test.parts:Encoder"]).model.system.length == 2.0
        module = sys.modules[own]
        stored = store.load(tmp_path / "m", classes=[module.Pendulum, module.Encoder])
        assert type(stored.model.system) is module.Pendulum and stored.classes.keys() == {
            name,
            "elsewhere_of_test.parts:Encoder",
        }
