"""The configuration: what is refused and in which words, and what is completed."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from expertaug.config import load as config
from expertaug.errors import InputError, InputErrors, lines
from shipped import refused

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", ["smoke", "ibm", "paper", "code"])
def test_shipped_files_are_valid(base, name, tmp_path):
    over = config.load([ROOT / "config" / f"{name}.yaml"])
    if name == "ibm":
        with pytest.raises(InputError, match=r"recordings\.markers\.path: missing; .* set recordings\.markers\.path"):
            config.validate(config.merge(base, over))
        over = config.merge(over, {"recordings": {"markers": {"path": str(tmp_path)}}})
    assert config.validate(config.merge(base, over)).results == f"results/{name}"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("sedes: [1]", "sedes: unknown key; did you mean 'seeds'?"),
        (
            "experiments: {pendulum: {training: {learning_rte: 1.0}}}",
            "experiments.pendulum.training.learning_rte: unknown key; did you mean 'learning_rate'?",
        ),
        (
            "experiments: {pendulum: {training: {learning_rate: 1e-3}}}",
            "experiments.pendulum.training.learning_rate: found '1e-3', which YAML takes for a text; write 1.0e-3",
        ),
        ("experiments: {pendulum: {model: {encoder: {latent: 1e2}}}}", "model.encoder.latent: found '1e2'"),
        ("seeds: [true]", "seeds[0]: found true; give a whole number"),
        (
            "experiments: {pendulum: {overrides: {mean: {training: {epochs: 1}}}}}",
            "overrides.mean.training.epochs: a method of kind mean is not trained; give it solver alone",
        ),
        ("experiments: {pendulum: null}", "experiments.pendulum: found null; give a mapping of keys"),
        (
            "experiments: {pendulum: {data: {noise: estimatd}}}",
            "data.noise: found 'estimatd'; did you mean 'estimated'?",
        ),
        ("experiments: {pendulum: {data: {noise: '0.1'}}}", "data.noise: found '0.1', which YAML takes for a text"),
        (
            "methods: {nobodys: {kind: hybrid, objective: aphinity, label: Nobody's}}",
            "methods.nobodys.objective: found 'aphinity'; did you mean 'aphynity'?",
        ),
        ("seeds: [1.5]", "seeds[0]: found 1.5; give a whole number"),
        ("seeds: [3, 1, 3]", "seeds[2]: 3 is there twice"),
        ("seeds: []", "seeds: found []; give 1 or more values"),
        ("recordings: {rendered: {noise: yes}}", "recordings.rendered.noise: found true; give a number"),
        ("recordings: {rendered: {crf: 60}}", "recordings.rendered.crf: found 60; give 51 or less"),
        ("recordings: {rendered: {duration_s: 0}}", "duration_s: found 0; give more than 0"),
        ("experiments: {pendulum: {data: {t1_s: .nan}}}", "data.t1_s: found .nan; give a number"),
        ("recordings: 3", "recordings: found 3; give a mapping of keys"),
        ("results: /dev/null/here", "results: '/dev/null' is no folder"),
        ("results: ''", "results: found ''; name a folder, without { } < > * or ?"),
        ("experiments: {pendulum: {model: {encoder: {latnt: 3}}}}", "encoder.latnt: unknown key; did you mean"),
        ("experiments: {pendulum: {model: {encoder: {kind: cnn}}}}", "model.encoder.kind: 'cnn' is no encoder"),
        ("experiments: {double_pendulum: {system: {l3: 0.1}}}", "double_pendulum.system.l3: unknown key"),
        (
            "experiments: {double_pendulum: {overrides: {aphynity: {system: {expertt: compound}}}}}",
            "double_pendulum.overrides.aphynity.system.expertt: unknown key",
        ),
        ("methods: {aphynity: {system: {expert: compound}}}", "methods.aphynity.system: unknown key; say it in the"),
        ("experiments: {pendulum: {training: {objective: {tau: 1.0}}}}", "training.objective.tau: unknown key"),
        (
            "experiments: {pendulum: {overrides: {aphynity: {training: {epoch: 3}}}}}",
            "experiments.pendulum.overrides.aphynity.training.epoch: unknown key; did you mean 'epochs'?",
        ),
        (
            "experiments: {pendulum: {choices: {resample: onec}}}",
            "choices.resample: found 'onec'; did you mean",
        ),
        ("preset: papr", "preset: found 'papr'; did you mean 'paper'?"),
        ("choices: {resample: once}", "choices: unknown key; say it in the experiments"),
        ("run: [pendulm]", "run[0]: 'pendulm' is no experiment; did you mean 'pendulum'?"),
        ("run: [pendulum, pendulum]", "run[1]: 'pendulum' is there twice"),
        (
            "experiments: {pendulum: {methods: [aphinity]}}",
            "methods[0]: 'aphinity' is no method; did you mean 'aphynity'?",
        ),
        ("experiments: {pendulum: {augmented: [mean]}}", "augmented[0]: 'mean' is of kind mean"),
        ("experiments: {pendulum: {methods: [mean]}}", "augmented[0]: 'expert_only' is no method of this experiment"),
        ("experiments: {x: {based_on: pendulu}}", "experiments.x.based_on: found 'pendulu'"),
        ("experiments: {x: {based_on: y}, y: {based_on: x}}", "is based on"),
        ("experiments: {x: {based_on: pendulum, training: {epochs: 0}}}", "experiments.x.training.epochs: found 0"),
        ("{run: [x], experiments: {x: {}}}", "experiments.x.system: missing"),
        (
            "experiments: {pendulum: {refinement: {units: {omega: shared}}}}",
            "experiments.pendulum.refinement.units.omega: 'omega' is no expert parameter; did you mean 'omega0'?",
        ),
        ("experiments: {pendulum: {refinement: {units: {omega0: all}}}}", "units.omega0: found 'all'; known: window"),
        (
            "experiments: {rlc: {overrides: {aphynity: {refinement: {units: {R: shared}}}}}}",
            "experiments.rlc.overrides.aphynity.refinement.units.R: 'R' is no expert parameter",
        ),
        (
            "{run: [x], experiments: {x: {based_on: pendulum_shift, training: {bound_z_a: true}}}}",
            "x.training.bound_z_a: found true; say it under finetuning: the trained model's z_a bound it",
        ),
        (
            "{run: [x], experiments: {x: {based_on: pendulum_shift, methods: [least_squares_shared], augmented: []}}}",
            "x.methods[0]: 'least_squares_shared' fits what windows share, and nothing is said to be shared; give "
            "refinement: {units: {omega0: shared}}",
        ),
        (
            "{run: [x], experiments: {x: {based_on: pendulum_shift, refinement: {units: {omega0: shared}}, "
            "augmentation: {prior: null}, augmented: []}}}",
            "x.refined[0]: windows of 'aphynity' share parameters, and nothing says where their fits start; give "
            "augmentation.prior",
        ),
        (
            "experiments: {recordings: {based_on: pendulum}}",
            "experiments.recordings: the results folder needs this name",
        ),
        (
            "experiments: {simulate: {based_on: pendulum}}",
            "experiments.simulate: a stage of the workflow has this name",
        ),
        ("experiments: {a b: {based_on: pendulum}}", "experiments: found the name 'a b'"),
        ("experiments: {pendulum: {system: {name: pendulums}}}", "system.name: 'pendulums' is no system"),
        ("experiments: {pendulum: {system: {name: no.such}}}", "system.name: no module 'no.such'"),
        ("experiments: {pendulum: {model: {encoder: {kind: 'no.such:X'}}}}", "model.encoder.kind: no module"),
        (
            "experiments: {pendulum: {augmentation: {prior: {omega0: [3.5, 0.5]}}}}",
            "augmentation.prior.omega0: found [3.5, 0.5]; min must not exceed max",
        ),
        (
            "experiments: {pendulum: {augmentation: {prior: {omega0: [0.5, 1.0e+39]}}}}",
            "augmentation.prior.omega0: found [0.5, 1e+39]; numbers up to 3.4e+38 can be computed with",
        ),
        (
            "experiments: {pendulum: {data: {sets: {test: {z_e: {omega: [1, 2]}}}}}}",
            "data.sets.test.z_e: names omega0, omega",
        ),
        (
            "experiments: {pendulum: {data: {sets: {validation: {z_a: {alpha: [0, 1]}}}}}}",
            "data.sets.iid: other ranges than validation's; give those of validation",
        ),
        (
            "experiments: {pendulum: {augmentation: {prior: {alpha: [1, 2]}}}}",
            "augmentation.prior: names omega0, alpha",
        ),
        ("experiments: {pendulum: {data: {t1_s: 30.0}}}", "t1_s must be less than t2_s"),
        ("experiments: {pendulum: {data: {t1_s: 5.05}}}", "give a multiple of step_s"),
        (
            "experiments: {pendulum: {training: {horizon_s: 21.0}}}",
            "training.horizon_s: found 21; the data end at 20 s",
        ),
        (
            "experiments: {pendulum: {overrides: {hvae: {finetuning: {horizon_s: 21.0}}}}}",
            "overrides.hvae.finetuning.horizon_s: found 21; the data end at 20 s",
        ),
        ("experiments: {double_pendulum: {data: {split: {train_share: 0.5}}}}", "the shares sum to 1.1"),
        ("experiments: {double_pendulum: {data: {split: {stride: 21}}}}", "give at most the length, 20"),
        ("experiments: {double_pendulum: {data: {split: {rate_hz: 150}}}}", "data.split.rate_hz: found 150"),
        ("recordings: {analysis_rate_hz: 300}", "recordings.analysis_rate_hz: found 300"),
        ("recordings: {source: videos}", "recordings.videos.path: missing"),
        ("recordings: {source: videos, videos: {path: nowhere}}", "recordings.videos.path: no video at 'nowhere'"),
        (
            "recordings: {source: markers, markers: {path: nowhere}}",
            "recordings.markers.path: 'nowhere' does not exist",
        ),
        (
            "experiments: {pendulum: {augmentations: {other: {prior: {omega: [1, 2]}}}}}",
            "pendulum.augmentations.other.prior: names omega; give a range for each parameter of the sets' z_e",
        ),
        ("experiments: {pendulum: {augmentations: {other: {budget: 1}}}}", "augmentations.other.budget: found 1; give"),
        (
            "experiments: {pendulum: {augmentations: {other: {prior: {omega0: [1, 2]}, methods: [mean]}}}}",
            "augmentations.other.methods[0]: 'mean' is no method under augmented",
        ),
        (
            "experiments: {pendulum: {studies: {during_trainin: {}}}}",
            "studies.during_trainin: unknown key; did you mean 'during_training'?",
        ),
        (
            "experiments: {pendulum: {studies: {data_curves: {noise: [pendulum, pendulm]}}}}",
            "studies.data_curves.noise[1]: 'pendulm' is no experiment of the run; did you mean 'pendulum'?",
        ),
        (
            "experiments: {pendulum: {studies: {data_curves: {samples: [double_pendulum]}}}}",
            "studies.data_curves.samples: 'double_pendulum' is measured; name simulated experiments",
        ),
        (
            "experiments: {pendulum: {studies: {data_curves: {samples: [pendulum, pendulum_shift]}}}}",
            "studies.data_curves.samples: 'pendulum' and 'pendulum_shift' both have 1000; name one of them",
        ),
        (
            "experiments: {pendulum: {studies: {data_curves: {}}}}",
            "studies.data_curves: no experiment; name some under samples or noise",
        ),
        (
            "experiments: {pendulum: {studies: {during_training: {method: aphynity}}}}",
            "studies.during_training.epochs: missing",
        ),
        (
            "experiments: {pendulum: {studies: {during_training: {method: aphinity, epochs: [1]}}}}",
            "studies.during_training.method: 'aphinity' is no method of this experiment; did you mean 'aphynity'?",
        ),
        (
            "experiments: {pendulum: {studies: {during_training: {method: aphynity, epochs: [1, 9999]}}}}",
            "studies.during_training.epochs[1]: found 9999; the training ends after",
        ),
        (
            "experiments: {pendulum: {studies: {along: {}}}}",
            "experiments.pendulum.studies.along: unknown key; it is called during_training now",
        ),
        (
            "experiments: {pendulum: {studies: {out_of_expertise: {distances: [a], panels: {x: [tests]}}}}}",
            "out_of_expertise.panels.x[0]: 'tests' is no set of this experiment; did you mean 'test'?",
        ),
        (
            "experiments: {pendulum: {studies: {out_of_expertise: {distances: [a, b], panels: {x: [test]}}}}}",
            "out_of_expertise.panels.x: 1 sets for 2 distances; give one set for each distance",
        ),
        ("experiments: {pendulum: {evaluation: {published: pendulm}}}", "evaluation.published: 'pendulm' is no system"),
        ("experiments: {pendulum: {evaluation: {overview: 1}}}", "evaluation.overview: found 1; give true or false"),
        ("experiments: {pendulum: {evaluation: {set_titles: {tes: x}}}}", "evaluation.set_titles.tes: unknown key"),
        (
            "experiments: {pendulum: {presets: {code: {training: {epoch: 3}}}}}",
            "experiments.pendulum.presets.code.training.epoch: unknown key; did you mean 'epochs'?",
        ),
        ("experiments: {pendulum: {presets: {cod: {}}}}", "presets.cod: unknown key; did you mean 'code'?"),
        (
            "experiments: {pendulum: {presets: {paper: {system: {omega: 1}}}}}",
            "experiments.pendulum.presets.paper.system.omega: unknown key",
        ),
        (
            "experiments: {pendulum: {presets: {code: {model: {encoder: {layrs: [3]}}}}}}",
            "experiments.pendulum.presets.code.model.encoder.layrs: unknown key; did you mean 'layers'?",
        ),
        (
            "experiments: {pendulum: {presets: {code: {studies: {horizns: null}}}}}",
            "experiments.pendulum.presets.code.studies.horizns",
        ),
        (
            "experiments: {pendulum_during_training: {based_on: pendulum}}",
            "experiments.pendulum_during_training: the files of 'pendulum' would have the same names",
        ),
    ],
)
def test_each_mistake_is_one_clear_line(base, text, expected):
    assert expected in refused(base, text)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("device: gpu", "device: found 'gpu'; did you mean 'cuda'?"),
        ("seeds: [4294967296]", "seeds[0]: found 4294967296; give less than 4294967296"),
        ("seeds: [18446744073709551616]", "seeds[0]: found 18446744073709551616; give less than"),
        ("experiments: {pendulum: {seeds: [1, 1]}}", "experiments.pendulum.seeds[1]: 1 is there twice"),
        ("results: ~no_such_user/x", "results: found '~no_such_user/x'; there is no such user"),
        ('results: "a\\0b"', "results: found 'a\\x00b'; remove its control characters"),
        ('recordings: {videos: {path: "a\\0b"}}', "recordings.videos.path: found 'a\\x00b'; remove its control"),
        (
            "recordings: {rendered: {count: 100000000000000000000000000}}",
            "recordings.rendered.count: found 100000000000000000000000000; give 10000 or less",
        ),
        ("recordings: {angles: {max_speed: 1" + "0" * 400 + "}}", "angles.max_speed: found 1000"),
        ("recordings: {rendered: {pivot_px: [1, 2]}}", "pivot_px: found [1.0, 2.0]; it must lie in the 480 px image"),
        ("recordings: {rendered: {arms_m: [1]}}", "arms_m: found [1]; give 2 values"),
        ("recordings: {tracking: {markers: {joint: {hue: [1, 2], x: 1}}}}", "markers.joint.x: unknown key"),
        ("experiments: {double_pendulum: {data: {split: {max_chunks: [1]}}}}", "give one value or a mapping of keys"),
        ("experiments: {double_pendulum: {data: {split: {max_chunks: {tran: 1}}}}}", "max_chunks.tran: unknown key"),
        ("experiments: {pendulum: {data: {step_s: null}}}", "data.step_s: found null; give a number"),
        ("experiments: 3", "experiments: found 3; give a mapping of keys"),
        ("{run: [x], experiments: {x: {system: {name: rlc}}}}", "experiments.x.data: missing; give data (where"),
    ],
)
def test_limits_of_machines_are_told_before_they_are_met(base, text, expected):
    assert expected in refused(base, text)


def test_one_mistake_is_told_once(base):
    """The further priors of the pendulum name the right parameters, whatever its own prior names."""
    over = {"experiments": {"pendulum": {"augmentation": {"prior": {"omega": [1, 2]}}}}}
    with pytest.raises(InputErrors) as caught:
        config.validate(config.merge(base, over))
    assert [error.where for error in caught.value.errors] == ["experiments.pendulum.augmentation.prior"]


def test_everything_that_is_wrong_is_told(base):
    experiments = "{pendulum: {training: {epochs: 0, batch_size: x}}, rlc: {methods: [m]}}"
    text = f"{{sedes: [1], device: gpu, experiments: {experiments}}}"
    with pytest.raises(InputErrors) as caught:
        config.validate(config.merge(base, yaml.safe_load(text)))
    assert [line.partition(": ")[0] for line in lines(caught.value)] == [
        "sedes",
        "device",
        "experiments.pendulum.training.batch_size",
        "experiments.pendulum.training.epochs",
        "experiments.rlc.methods[0]",
    ]
    assert str(caught.value) == lines(caught.value)[0]


def test_what_an_experiment_inherits_is_told_once(base):
    with pytest.raises(InputErrors) as caught:
        config.validate(config.merge(base, {"experiments": {"pendulum": {"data": {"t1_s": 5.05}}}}))
    assert [line.partition(": ")[0] for line in lines(caught.value)] == ["experiments.pendulum.data.t1_s"]


def test_experiments_that_are_not_run_need_not_be_sound(base):
    over = {"experiments": {"pendulum": {"methods": ["mean"]}}}
    with pytest.raises(InputError):
        config.validate(config.merge(base, over))
    found = config.validate(config.merge(base, over | {"run": ["double_pendulum"]}))
    assert "pendulum" not in found.experiments and "rlc" in found.experiments


def test_results_may_begin_with_the_home_folder(base, monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    assert config.validate(config.merge(base, {"results": "~/x/"})).results == f"{tmp_path}/x"


def test_what_augmented_methods_need_is_named(base):
    changed = config.merge(base, {})
    del changed["experiments"]["pendulum"]["finetuning"]
    with pytest.raises(InputError, match=r"experiments\.pendulum\.finetuning: missing"):
        config.validate(changed)


def test_completion_inherits_fills_and_resolves(base):
    x = {"based_on": "pendulum", "data": {"noise": 0}, "choices": {"resample": "once"}}
    over = {"experiments": {"x": x}}
    found = config.validate(config.merge(base, over))
    x, pendulum = found.experiments["x"], found.experiments["pendulum"]
    assert x.data == pendulum.data.model_copy(update={"noise": 0.0}) and isinstance(x.data.noise, float)
    assert "based_on" not in x.dump()
    assert x.training.checkpoint_s == 30.0
    assert x.choices.resample == "once" and x.choices.selection == "observed"
    assert found.tracking.uri == "sqlite:///results/mlflow/mlflow.db"
    chosen = config.validate(base).experiments["pendulum"].choices
    assert chosen.resample == "epoch", "the input must not be changed"


def test_completed_configuration_is_valid_again(base):
    assert config.validate(config.validate(base).dump()) == config.validate(base)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"controls": ["mean"]}, "controls[0]: 'mean' is of kind mean; only hybrid methods can be trained on"),
        ({"controls": ["aphinity"]}, "controls[0]: 'aphinity' is no method; did you mean 'aphynity'?"),
        ({"refined": ["aphynity+~refined"]}, "refined[0]: found 'aphynity+~refined'; name the version that is to be"),
        ({"refined": ["aphynitty+"]}, "refined[0]: 'aphynitty' is no method; did you mean 'aphynity'?"),
        ({"refined": ["least_squares"]}, "refined[0]: 'least_squares' is of kind least_squares"),
        (
            {"refinement": {"windows": {"speed": [0, 1]}}},
            "refinement.windows.speed: 'speed' is no component of",
        ),
        ({"refinement": {"starts": 0}}, "refinement.starts: found 0; truth has no other starts"),
        (
            {"overrides": {"alternating": {"refinement": {"starts": 0}}}},
            "overrides.alternating.refinement.starts: found 0; alternating has no other starts",
        ),
        ({"refinement": {"tries": 0}}, "refinement.tries: found 0"),
    ],
)
def test_mistakes_in_controls_and_refinement(base, more, message):
    with pytest.raises(InputError) as raised:
        config.validate(config.merge(base, {"experiments": {"pendulum": more}}))
    assert message in str(raised.value)


def test_files_override_what_they_include(tmp_path):
    (tmp_path / "below").mkdir()
    (tmp_path / "below" / "a.yaml").write_text("run: [a]\nmethods: {m: {kind: mean}}\n")
    (tmp_path / "b.yaml").write_text("include: [below/a.yaml]\nrun: [b]\n")
    assert config.load([tmp_path / "b.yaml"]) == {"run": ["b"], "methods": {"m": {"kind": "mean"}}}
    (tmp_path / "below" / "a.yaml").write_text("include: [../b.yaml]\n")
    with pytest.raises(InputError, match="files include each other"):
        config.load([tmp_path / "b.yaml"])
