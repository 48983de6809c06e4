"""The command check-system: each mistake in a class or a configuration of one's own is one line, before any job."""

from __future__ import annotations

import logging
import re
import sys

import pytest
import torch
import yaml

from expertaug import cli
from expertaug.config import load as config
from expertaug.config.models import Configuration
from expertaug.runs.own_classes import check_classes
from nightly import others_slow
from test_own_system import EXPERIMENT, SYSTEM

TRUTH = "return self._rates(y, z_e, 1 / (1 + z_a[..., 0] * y[..., 0]))"
EXPERT = "return self._rates(y, z_e, 1.0)"
SAMPLER = "return 1 + 3 * torch.rand(n, 2, generator=generator, dtype=torch.float64)"
PARTS = (
    "from plain_parts import *\n\nclass NumberOfLayers(LinearEncoder):\n    def __init__(self, system, times, layers):"
)
PARTS += "\n        super().__init__(system, times, layers[0])\n"
ONE = ("experiments", "predation")
ENCODER, INTERACTION = ("model", "encoder"), ("model", "interaction")
SYSTEM_FILE = r"experiments\.predation, system \(own/predation\.py\): LotkaVolterra"


@pytest.fixture
def project(tmp_path, monkeypatch):
    """Writes a system and a configuration, with changes, into a folder that Python finds; gives the file."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    for name in [name for name in sys.modules if name.partition(".")[0] == "own"]:
        monkeypatch.delitem(sys.modules, name)
    root = logging.getLogger()
    handlers, level = list(root.handlers), root.level

    def written(*replaced: tuple[str, str], **changes):
        text = SYSTEM
        for old, new in replaced:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / "own").mkdir()
        for name, content in (("__init__", ""), ("predation", text), ("parts", PARTS)):
            (tmp_path / "own" / f"{name}.py").write_text(content)
        short = config.merge(yaml.safe_load(EXPERIMENT), one(6.0, "data", "t2_s"))
        (tmp_path / "my.yaml").write_text(yaml.safe_dump(config.merge(short, changes)))
        return tmp_path / "my.yaml"

    yield written
    for name in [name for name in sys.modules if name.partition(".")[0] == "own"]:
        del sys.modules[name]
    root.handlers, root.level = handlers, level


def one(value: object, *path: str) -> dict:
    """A change of the experiment at a path."""
    for key in reversed((*ONE, *path)):
        value = {key: value}
    return value


def objective(name: str, **options: object) -> dict:
    found = {"methods": {"own": {"kind": "hybrid", "label": "Own", "objective": name}}}
    return found | one({"methods": ["own"], "augmented": [], "training": {"objective": options}})


def test_what_is_right_is_told_line_by_line(project, capsys):
    assert cli.main(["check-system", str(project())]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "predation: system LotkaVolterra checked",
        "predation: method expert_only checked",
        "predation: method aphynity checked",
    ]


@pytest.mark.parametrize(
    "change",
    others_slow(
        [
            one({"kind": "plain_parts:LinearEncoder"}, *ENCODER),
            one({"kind": "plain_parts:KeywordEncoder", "gain": 2.0}, *ENCODER),
            one({"kind": "plain_parts:SpectralInteraction"}, *INTERACTION),
            one([5.0, 6.0], "training", "objective", "lambda0"),
            {"seeds": [0, 1, 2], "seeds_per_job": 3} | one([5.0, 6.0, 7.0], "training", "objective", "lambda0"),
            one({"methods": ["hvae"], "augmented": ["hvae"]})
            | {"methods": {"hvae": {"kind": "hybrid", "label": "HVAE", "objective": "hvae"}}}
            | one({"kind": "two_step", "latent_layers": [4], "filter_layers": [4], "expert_layers": [4]}, *ENCODER),
        ],
        2,
    ),
)
def test_ordinary_parts_pass(project, change):
    assert cli.main(["check-system", str(project(**change))]) == 0


MISTAKES = {
    "truth": ([(TRUTH, f"{TRUTH}[..., 0]")], {}, rf"{SYSTEM_FILE}\.truth gives shape \(3,\); give \(3, 2\)"),
    "expert": ([(EXPERT, f"{EXPERT}.sum(-1)")], {}, rf"{SYSTEM_FILE}\.expert gives shape \(3,\); give \(3, 2\)"),
    "initial_state": (
        [(EXPERT, f"{EXPERT}\n\n    def initial_state(self, y0, z_e):\n        return y0[..., 0]")],
        {},
        rf"{SYSTEM_FILE}\.initial_state gives shape \(3,\); give \(3, 2\)",
    ),
    "sampler_shape": ([(SAMPLER, f"{SAMPLER}[:, 0]")], {}, rf"{SYSTEM_FILE}\.sample_initial_state gives shape \(3,\)"),
    "numpy": ([(EXPERT, f"{EXPERT}.detach().numpy()")], {}, rf"{SYSTEM_FILE}\.expert gives ndarray; give a torch tens"),
    "unseeded": (
        [(SAMPLER, SAMPLER.replace(" generator=generator,", ""))],
        {},
        rf"{SYSTEM_FILE}\.sample_initial_state gives other states for the same generator; draw with generator=gen",
    ),
    "constructor": (
        [("b: float = 0.5", "b=0.5"), ("self.b, self.d = b, d", "self.b, self.d = b + 0.0, d")],
        one("0,5", "system", "b"),
        r"experiments\.predation\.system: system: LotkaVolterra refuses its arguments \(TypeError: .*; correct them",
    ),
    "text_for_a_number": (
        [],
        one("much", "system", "b"),
        r"experiments\.predation\.system\.b: found 'much'; give a num",
    ),
    "negative_range": (
        [],
        one([-0.5, 1.0], "data", "sets", "test", "z_e", "a"),
        r"experiments\.predation\.data\.sets\.test\.z_e: a of LotkaVolterra is positive and its range starts at -0\.5",
    ),
    "negative_prior": (
        [],
        one([-1.0, 1.0], "augmentation", "prior", "c"),
        r"experiments\.predation\.augmentation\.prior: c of LotkaVolterra is positive and its range starts at -1; nar",
    ),
    "diverging": (
        [(TRUTH, TRUTH.replace("y[..., 0]))", "y[..., 0])) + y.square().square()"))],
        {},
        r"experiments\.predation, system \(own/predation\.py\): LotkaVolterra, set train.*; narrow the ranges, or corr",
    ),
    "layers_of_own": (
        [],
        one({"kind": "own.parts:NumberOfLayers", "layers": "16"}, *ENCODER),
        r"experiments\.predation, expert_only \(own/parts\.py\): model\.encoder: .*NumberOfLayers refuses its argum",
    ),
    "layers": ([], one("16", *ENCODER, "layers"), r"experiments\.predation\.model\.encoder\.layers: found '16'; give"),
    "activation": (
        [],
        one("zzz", *ENCODER, "activation"),
        r"experiments\.predation\.model\.encoder\.activation: found 'zzz'; ",
    ),
    "window": ([], one([0, 5], *ENCODER, "windows", "z"), r"encoder\.windows\.z: 'z' is no component of the state; "),
    "window_past_t1": (
        [],
        one([0, 6], *ENCODER, "windows", "x"),
        r"encoder\.windows\.x: found \[0\.?0?, 6\.?0?\] s; choose",
    ),
    "component": (
        [],
        one(["x", "q"], *INTERACTION, "components"),
        r"interaction\.components\[1\]: 'q' is no component of the state; ",
    ),
    "encoder_shape": (
        [],
        one({"kind": "plain_parts:FlatEncoder"}, *ENCODER),
        r"experiments\.predation, expert_only \(.*plain_parts\.py\): model\.encoder: FlatEncoder gives z_e of",
    ),
    "interaction_shape": (
        [],
        one({"kind": "plain_parts:WrongShape"}, *INTERACTION),
        r"experiments\.predation, aphynity \(.*plain_parts\.py\): model\.interaction: WrongShape gives sh",
    ),
    "dropout": ([], one({"kind": "plain_parts:DropoutEncoder"}, *ENCODER), r"DropoutEncoder draws random numbers"),
    "loss": (
        [],
        objective("plain_parts:ScalarLoss"),
        r"the loss of ScalarLoss has shape \(\); give one number for each seed, \(2,\)",
    ),
    "cuda": ([], {"device": "cuda"}, r"device: 'cuda', and torch finds none here; give auto or cpu"),
}
IN_CONSTRUCTOR = [
    ('    state = (Parameter("x"), Parameter("y"))\n', ""),
    ("self.b, self.d = b, d", 'self.b, self.d = b, d\n        self.state = (Parameter("x"), Parameter("y"))'),
]
MISTAKES["window_past_t1_of_a_state_made_later"] = (IN_CONSTRUCTOR, *MISTAKES["window_past_t1"][1:])
MISTAKES["component_of_a_state_made_later"] = (
    IN_CONSTRUCTOR,
    MISTAKES["component"][1],
    r"experiments\.predation, aphynity: model\.interaction\.components: 'q'; components of the state: x, y",
)


@pytest.mark.parametrize("mistake", MISTAKES)
def test_each_mistake_is_one_line_and_status_2(mistake, project, capsys, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    replaced, change, expected = MISTAKES[mistake]
    assert cli.main(["check-system", str(project(*replaced, **change))]) == 2
    said = capsys.readouterr().err
    assert said.startswith("expertaug check-system: ") and said.count("\n") == 1
    assert re.search(expected, said), said


def test_what_is_wrong_in_any_experiment_is_told(project, capsys):
    other = {
        "based_on": "predation",
        "model": {"encoder": {"kind": "plain_parts:FlatEncoder"}, "interaction": {"kind": "plain_parts:WrongShape"}},
    }
    third = {"based_on": "predation", "augmentation": {"prior": {"a": [-1.0, 1.0]}}}
    file = project(run=["predation", "other", "third"], experiments={"other": other, "third": third})
    assert cli.main(["check-system", str(file)]) == 2
    said = capsys.readouterr().err.splitlines()
    assert [line.split(": ")[1] for line in said[1:]] == ["experiments.third.augmentation.prior"]
    assert re.search(r"experiments\.other, expert_only .*: FlatEncoder", said[0])


def complete(file) -> Configuration:
    return config.complete_configuration(config.load(config.with_defaults([file])))


def test_points_of_a_grid_are_checked(project):
    study = {"grid": {"method": "aphynity", "keys": {"model.interaction.layers": [[4], [8]]}}}
    lines = check_classes(complete(project(**one(study, "studies"))))
    assert lines[-2:] == ["predation: method aphynity@1 checked", "predation: method aphynity@2 checked"]


def test_only_what_is_from_elsewhere_is_checked_before_a_run(project, tmp_path):
    assert len(check_classes(complete(project()), only_own=True)) == 3
    mixed = tmp_path / "mixed.yaml"
    # The package's own system, and an F_a from elsewhere in one of three methods.
    mixed.write_text(
        "{run: [rlc], experiments: {rlc: {methods: [mean, expert_only, aphynity], augmented: [], "
        "model: {interaction: {kind: 'plain_parts:LinearInteraction'}}}}}"
    )
    assert check_classes(complete(mixed), only_own=True) == [
        "rlc: system RLC checked",
        "rlc: method aphynity checked",
    ]
    plain = tmp_path / "plain.yaml"
    plain.write_text("{}")
    assert check_classes(complete(plain), only_own=True) == []
