"""The configuration: what is refused and in which words, what is completed, and that schema and settings agree."""

from __future__ import annotations

import inspect
import json
import re
from pathlib import Path

import pytest
import yaml
from jsonschema import Draft202012Validator

from expertaug.config import (
    jobs,
    recording_settings,
    reference,
    schema,
    shown_settings,
    sources,
    stage_settings,
)
from expertaug.config import load as config
from expertaug.config.models import Configuration
from expertaug.errors import InputError, InputErrors, lines
from expertaug.learning.settings import TrainSettings
from expertaug.stages import STAGES, planned
from expertaug.wording import number_in
from expertaug_recordings.settings import (
    CalibrateJob,
    ExtractFramesJob,
    ImportMarkersJob,
    MeasureAnglesJob,
    RenderVideoJob,
    SplitChunksJob,
    TrackMarkersJob,
    UnpackMarkersJob,
)

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def base() -> dict:
    return config.load([ROOT / "config" / "config.yaml"])


def refused(base: dict, text: str) -> str:
    with pytest.raises(InputError) as caught:
        config.validate(config.merge(base, yaml.safe_load(text)), STAGES)
    message = str(caught.value)
    assert "\n" not in message
    return message


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


def test_a_long_chain_of_experiments_is_one_line(base):
    chain = {f"e{k}": {"based_on": f"e{k + 1}"} for k in range(1500)} | {"e1500": {"based_on": "pendulum"}}
    found = refused(base, yaml.safe_dump({"experiments": chain}))
    assert "based_on: more than 100 experiments, one based on the next" in found


def test_results_may_begin_with_the_home_folder(base, monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    assert config.validate(config.merge(base, {"results": "~/x/"})).results == f"{tmp_path}/x"


def test_an_experiment_may_have_seeds_of_its_own(base):
    found = config.validate(config.merge(base, {"experiments": {"rlc": {"seeds": [7, 8]}}}))
    assert jobs.seed_groups(found, "rlc") == {"seeds_7_8": [7, 8]}
    assert jobs.seed_groups(found, "pendulum") == jobs.seed_groups(found) == {"seeds_0_1_2": [0, 1, 2]}
    for stage, method in ((stage_settings.train, "aphynity"), (stage_settings.finetune, "aphynity+")):
        assert stage(found, "rlc", method, "seeds_7_8")["seeds"] == [7, 8]


def test_editors_see_what_the_files_may_say():
    validator = Draft202012Validator(schema.schema())
    files = [*(ROOT / "config").glob("*.yaml"), *(ROOT / "config" / "experiments").glob("*.yaml")]
    assert len(files) > 7
    for file in files:
        text = file.read_text(encoding="utf-8")
        found = re.match(r"# yaml-language-server: \$schema=(\S+)", text)
        assert found and (file.parent / found[1]).resolve() == ROOT / "config" / "schema.json"
        assert not list(validator.iter_errors(yaml.safe_load(text)))
    wrong = {
        "model": {"encoder": {"kind": "window", "layers": "x"}},
        "training": {"epoch": 1},
        "overrides": {"hvae": {"training": {"epochs": 0}}},
    }
    places = {tuple(e.absolute_path)[2:4] for e in validator.iter_errors({"experiments": {"x": wrong}})}
    assert places == {("model", "encoder"), ("training",), ("overrides", "hvae")}


def test_what_augmented_methods_need_is_named(base):
    changed = config.merge(base, {})
    del changed["experiments"]["pendulum"]["finetuning"]
    with pytest.raises(InputError, match=r"experiments\.pendulum\.finetuning: missing"):
        config.validate(changed)


def test_a_file_that_is_not_yaml_is_named_with_its_line(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text("seeds: [1\nrun: x\n")
    with pytest.raises(InputError, match=r"a\.yaml:2:\d+: not YAML"):
        config.load([path])
    path.write_text("- 1\n")
    with pytest.raises(InputError, match="a configuration is a mapping"):
        config.load([path])
    with pytest.raises(InputError, match="cannot be read"):
        config.load([tmp_path / "none.yaml"])


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


def test_slices_are_settings_of_their_stages(base, tmp_path):
    (tmp_path / "a.mp4").touch()
    for source in ("rendered", "videos", "markers"):
        own = {"rendered": {}, "videos": {"path": str(tmp_path), "from_s": 0.5, "to_s": 2.0}}
        over = {"recordings": {"source": source, source: own.get(source, {"path": str(tmp_path)})}}
        found = config.validate(config.merge(base, over))
        for kind, settings in (
            (RenderVideoJob, recording_settings.render_video(found)),
            (ExtractFramesJob, recording_settings.extract_frames(found)),
            (TrackMarkersJob, recording_settings.track_markers(found)),
            (UnpackMarkersJob, recording_settings.unpack_markers(found)),
            (ImportMarkersJob, recording_settings.import_markers(found)),
            (MeasureAnglesJob, recording_settings.measure_angles(found)),
            (SplitChunksJob, recording_settings.split_chunks(found, "double_pendulum")),
            (CalibrateJob, recording_settings.calibrate(found, "double_pendulum")),
        ):
            assert isinstance(settings, kind)
            kind(**json.loads(settings.model_dump_json(exclude_unset=True)))
        TrainSettings.from_mapping(stage_settings.train(found, "pendulum", "aphynity", "seeds_0_1_2")["training"])


def test_slices_hold_only_what_their_stage_uses(base):
    found = config.validate(base)
    group = "seeds_0_1_2"
    other = config.validate(
        config.merge(
            base,
            {
                "recordings": {"rendered": {"count": 3}},
                "experiments": {
                    "pendulum": {
                        "choices": {"resample": "once", "forecast_start": "y_t1"},
                        "finetuning": {"epochs": 7},
                        "data": {"sets": {"test": {"size": 7}}},
                    }
                },
            },
        )
    )
    same = [
        (stage_settings.train, "pendulum", "aphynity", group),
        (stage_settings.augment, "pendulum", "aphynity", group),
        (stage_settings.simulate, "pendulum", "train"),
        (recording_settings.render_video,),
    ]
    for stage, *names in same:
        assert stage(found, *names) == stage(other, *names)
    changed = [
        (stage_settings.finetune, "pendulum", "aphynity", group),
        (stage_settings.evaluate, "pendulum", "aphynity+", group),
        (stage_settings.simulate, "pendulum", "test"),
    ]
    for stage, *names in changed:
        assert stage(found, *names) != stage(other, *names)


def test_blocks_and_variants(base):
    methods = {"methods": ["mean", "aphynity"], "augmented": ["aphynity"]}
    own = {"experiments": {"x": {"based_on": "pendulum", **methods, "controls": [], "flows": [], "refined": []}}}
    found = config.validate(config.merge(base, own | {"seeds": [4, 0, 7], "seeds_per_job": 2}))
    assert jobs.seed_groups(found) == {"seeds_4_0": [4, 0], "seeds_7": [7]}
    assert jobs.variants(found, "x") == ["mean", "aphynity", "aphynity+"]
    assert jobs.label(found, "aphynity+") == "APHYNITY+"
    # Controls and refined versions that are inherited count for the methods that are there.
    own["experiments"]["x"] |= {"controls": ["aphynity", "hvae"], "refined": ["aphynity+", "hvae", "aphynity="]}
    found = config.validate(config.merge(base, own))
    expected = ["mean", "aphynity", "aphynity=", "aphynity=~refined", "aphynity+", "aphynity+~refined"]
    assert jobs.variants(found, "x") == expected


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


def test_noise_follows_the_preset(base):
    paper = config.validate(config.merge(base, {"preset": "paper"}))
    assert stage_settings.simulate(paper, "pendulum", "train")["data"]["noise"] == 0.0
    assert stage_settings.simulate(config.validate(base), "pendulum", "train")["data"]["noise"] == 0.01


def test_videos_of_one_name_are_refused(tmp_path):
    for name in ("a.mp4", "b.mkv", "notes.txt"):
        (tmp_path / name).touch()
    assert list(sources.list_videos(str(tmp_path))) == ["a", "b"]
    assert list(sources.list_videos(str(tmp_path / "*.mkv"))) == ["b"]
    (tmp_path / "A.avi").touch()
    with pytest.raises(InputError, match="two files of one name"):
        sources.list_videos(str(tmp_path))


@pytest.mark.parametrize(
    ("text", "number"),
    [("1e-3", "1.0e-3"), ("2E5", "2.0e+5"), (".5e3", ".5e+3"), ("12", "12"), ("e3", None), ("x", None)],
)
def test_numbers_are_written_as_yaml_wants_them(text, number):
    assert number_in(text) == number
    if number:
        assert isinstance(yaml.safe_load(number), int | float)


def test_what_is_made_from_the_models_is_as_they_are():
    text = (ROOT / "config" / "README.md").read_text(encoding="utf-8")
    assert text.partition(reference.BEGIN)[2].strip() == reference.reference().strip(), "see the README's marker"
    found = json.loads((ROOT / "config" / "schema.json").read_text(encoding="utf-8"))
    assert found == schema.schema(), "python -m expertaug.config.schema config/schema.json"


def test_results_that_cannot_be_written(base: dict, monkeypatch: pytest.MonkeyPatch) -> None:
    """Root may write anywhere, so the answer of the system is replaced."""
    monkeypatch.setattr("expertaug.config.checks.os.access", lambda *_: False)
    assert "cannot be written; choose a writable results folder" in refused(base, "results: here")


def test_experiments_and_methods_may_override(base: dict) -> None:
    over = "{choices: {resample: epoch}, overrides: {ml_only: {model: {interaction: {layers: [7]}}}}}"
    changed = config.validate(config.merge(base, yaml.safe_load(f"experiments: {{pendulum: {over}}}")))
    trained = [stage_settings.train(changed, "pendulum", method, "seeds_0_1_2") for method in ("ml_only", "aphynity")]
    own = base["experiments"]["pendulum"]["model"]["interaction"]
    assert trained[0]["model"]["interaction"]["layers"] == [7] and trained[1]["model"]["interaction"] == own
    assert stage_settings.finetune(changed, "pendulum", "aphynity", "seeds_0_1_2")["choices"]["resample"] == "epoch"


def test_an_experiment_may_differ_under_a_preset(base: dict) -> None:
    presets = {"code": {"data": {"noise": 0.5}}, "paper": {"training": {"epochs": 7}}}
    over = {"experiments": {"pendulum": {"presets": presets}, "x": {"based_on": "pendulum", "data": {"noise": 0.1}}}}
    found = {p: config.validate(config.merge(base, over | {"preset": p})).experiments for p in ("code", "paper")}
    plain = config.validate(base).experiments["pendulum"]
    assert [found[p]["pendulum"].data.noise for p in found] == [0.5, plain.data.noise]
    assert [found[p]["x"].data.noise for p in found] == [0.5, 0.1], "an inherited preset wins as well"
    assert found["paper"]["pendulum"].training.epochs == 7
    assert found["code"]["pendulum"].presets is None
    default = config.validate(config.merge(base, over)).experiments["pendulum"]
    assert default.data == plain.data and default.training == plain.training


def test_choices_win_over_those_of_an_experiments_presets(base: dict) -> None:
    presets = {"corrected": {"choices": {"resample": "epoch", "supervision": "raw"}}}
    over = {"experiments": {"pendulum": {"presets": presets}}}
    by_default = config.validate(config.merge(base, over)).experiments["pendulum"].choices
    assert (by_default.resample, by_default.supervision) == ("epoch", "raw")
    of_code = config.validate(config.merge(base, over | {"preset": "code"})).experiments["pendulum"].choices
    assert of_code.resample == "once"
    over["experiments"]["pendulum"]["choices"] = {"resample": "once"}
    chosen = config.validate(config.merge(base, over)).experiments["pendulum"].choices
    assert (chosen.resample, chosen.supervision) == ("once", "raw")


# An experiment without studies, on which the next is built.
PLAIN = """
run: [plain]
experiments:
  plain:
    based_on: pendulum
    methods: [mean, ml_only, aphynity]
    augmented: [aphynity]
    augmentations: {narrow: null, wide: null}
"""
STUDIES = """
experiments:
  plain:
    data: {sets: {near: {size: 5, z_e: {omega0: [1.5, 3.1]}, z_a: {alpha: [0.6, 1.0]}}}}
    augmentations: {wide: {prior: {omega0: [0.1, 7.0]}}}
    studies:
      during_training: {method: aphynity, epochs: [5, 1]}
      out_of_expertise: {distances: [none, near], panels: {z_a: [test, near]}, overview: near}
  x: {based_on: plain, augmentations: {wide: null}, studies: {during_training: null}}
"""


def test_null_takes_an_inherited_set_away(base: dict) -> None:
    def over(name: str) -> dict:
        return config.merge(base, {"run": ["pendulum"], "experiments": {"pendulum": {"data": {"sets": {name: None}}}}})

    assert "iid" in config.validate(base).experiments["pendulum"].data.set_names
    assert "iid" not in config.validate(over("iid")).experiments["pendulum"].data.set_names
    with pytest.raises(InputError, match=r"pendulum\.data\.sets\.train: missing"):
        config.validate(over("train"))


def test_studies_change_only_the_jobs_that_they_need(base: dict) -> None:
    base = config.merge(base, yaml.safe_load(PLAIN))
    group, plain = "seeds_0_1_2", config.validate(base)
    assert jobs.studies(plain, "plain") == []
    found = config.validate(config.merge(base, yaml.safe_load(STUDIES)))
    assert jobs.studies(found, "plain") == ["during_training", "out_of_expertise", "prior_width"]
    assert jobs.studies(found, "x") == ["out_of_expertise"], "null takes away"
    assert jobs.variants(found, "plain") == jobs.variants(plain, "plain")
    assert "aphynity+wide" in jobs.further_variants(found, "plain")
    assert jobs.list_studied(found, "plain", "prior_width")[:2] == ["aphynity", "aphynity+"]
    trained = stage_settings.train(found, "plain", "aphynity", group)
    assert trained.pop("snapshots") == [1, 5]
    assert trained == stage_settings.train(plain, "plain", "aphynity", group)
    assert stage_settings.train(found, "plain", "ml_only", group) == stage_settings.train(
        plain, "plain", "ml_only", group
    )
    for stage in (stage_settings.augment, stage_settings.finetune):
        assert stage(found, "plain", "aphynity+", group) == stage(plain, "plain", "aphynity+", group)
    wide = stage_settings.augment(found, "plain", "aphynity+wide", group)
    assert wide["prior"] == {"omega0": [0.1, 7.0]} and wide["method"] == "aphynity+wide"
    assert stage_settings.finetune(found, "plain", "aphynity+wide", group)["label"] == "APHYNITY+ (wide)"
    assert stage_settings.evaluate(found, "plain", "aphynity", group)["sets"][-1] == "near"
    along = stage_settings.during_training(found, "plain", "aphynity", group)
    assert along["finetune"] == stage_settings.finetune(found, "plain", "aphynity+", group)
    assert along["finetune_epochs"] == [1, 10]
    assert shown_settings.tabulate(found, "plain") == shown_settings.tabulate(plain, "plain")


def test_recordings_are_listed_by_name(base: dict, tmp_path: Path) -> None:
    for name in ("10.csv", "2.csv", "a.mp4"):
        (tmp_path / name).touch()
    found = {}
    for source in ("rendered", "videos", "markers"):
        over = {"recordings": {"source": source, source: {"path": str(tmp_path)} if source != "rendered" else {}}}
        found[source] = sources.list_recordings(config.validate(config.merge(base, over)))
    assert list(found["rendered"].values()) == list(range(6))
    assert found["videos"] == {"a": str(tmp_path / "a.mp4")}
    assert found["markers"] == {"2": str(tmp_path / "2.csv"), "10": str(tmp_path / "10.csv")}
    simulated = config.validate(config.merge(base, {"run": ["pendulum"]}))
    assert sources.list_recordings(simulated) == {}


def test_horizons_and_dissipation_of_recordings(base):
    over = yaml.safe_load("experiments: {double_pendulum: {data: {split: {horizons_s: [1.0, 0.5]}}}}")
    found = config.validate(config.merge(base, over))
    sets = ["train", "validation", "test", "validation_1s", "test_1s", "validation_500ms", "test_500ms"]
    assert found.experiments["double_pendulum"].data.set_names == sets
    assert stage_settings.evaluate(found, "double_pendulum", "aphynity", "seeds_0_1_2")["sets"] == sets
    assert found.experiments["pendulum"].data.set_names == ["train", "validation", "iid", "test"]
    assert not recording_settings.split_chunks(found, "double_pendulum").horizons_s, "a horizon redoes no training"
    one = recording_settings.cut_horizon(found, "double_pendulum", "test_500ms")
    assert one.set == "test_500ms" and one.split.horizons_s == [0.5]
    study = shown_settings.study(found, "double_pendulum", "horizons")["options"]
    panels = [["validation", "validation_1s", "validation_500ms"], ["test", "test_1s", "test_500ms"]]
    assert study == {"distances": ["0.19 s", "1 s", "0.5 s"], "panels": [[one[0], one] for one in panels]}
    shown = stage_settings.dissipation(found, "double_pendulum")["versions"]
    refined = ["aphynity~refined", "hvae~refined"]
    assert [v for v, _, fit in shown if fit and v in refined] == refined
    assert [v for v, *_ in shown if v not in refined] == ["least_squares_friction", "aphynity", "hvae", "alternating"]
    assert jobs.dissipating(found, "pendulum") == []
    assert jobs.studies(config.validate(base), "double_pendulum") == ["during_training"]
    assert "found 0.1; chunks end at 0.19 s already" in refused(
        base, "experiments: {double_pendulum: {data: {split: {horizons_s: [0.1]}}}}"
    )


def test_horizons_of_tables(base, tmp_path):
    (tmp_path / "lab.csv").write_text("t,angle,speed\n0,0,0\n")
    files = {"paths": str(tmp_path / "lab.csv"), "columns": {"theta": "angle", "omega": "speed"}, "horizons_s": [1.0]}
    lab = {"based_on": "pendulum", "data": {"source": "files", "files": files}, "methods": ["aphynity"]}
    lab |= {"augmented": ["aphynity"], "controls": [], "refined": [], "flows": []}
    given = config.merge(base, {"run": ["lab"], "experiments": {"lab": lab}})
    found = config.validate(given)
    assert found.experiments["lab"].data.set_names == ["train", "validation", "test", "validation_1s", "test_1s"]
    cut = recording_settings.cut_measurements(found, "lab")
    assert "horizons_s" not in cut["files"], "a horizon redoes no training"
    one = recording_settings.cut_measured_horizon(found, "lab", "test_1s")
    assert one["set"] == "test_1s" and one["files"]["horizons_s"] == [1.0]
    assert shown_settings.study(found, "lab", "horizons")["options"]["distances"] == ["20 points", "1 s"]
    for change, message in (({"horizons_s": [1.0, 1.0]}, "give each once"), ({"step_s": 0.1}, "chunks end at 1.9 s")):
        wrong = {"experiments": {"lab": {"data": {"files": change}}}}
        with pytest.raises(InputError, match=message):
            config.validate(config.merge(given, wrong))


def test_figures_of_lines_show_the_classical_estimator_and_the_experiments_own_expert_first(base, tmp_path):
    shown = ["least_squares", "aphynity", "aphynity+", "hvae", "hvae+", "alternating"]
    over = config.load([ROOT / "config" / "ibm.yaml"])
    recorded = config.merge(over, {"recordings": {"markers": {"path": str(tmp_path)}}})
    for given, experiment in ((base, "pendulum"), (config.merge(base, recorded), "double_pendulum_time")):
        assert shown_settings.plot(config.validate(given), experiment)["traced"] == shown


class TestCards:
    """Jobs that compute on a card ask for it, and a run has one: no two of them are on it at a time."""

    @pytest.mark.parametrize(
        ("device", "driver", "usable", "asked"),
        [("cpu", True, True, 0), ("cuda", False, False, 1), ("auto", False, True, 0), ("auto", True, True, 1)],
    )
    def test_a_job_asks_for_one_where_it_would_take_it(self, monkeypatch, tmp_path, device, driver, usable, asked):
        monkeypatch.setattr(jobs, "DRIVERS", [tmp_path if driver else tmp_path / "none"])
        monkeypatch.setattr("torch.cuda.is_available", lambda: usable)
        assert jobs.cards(Configuration.model_construct(device=device)) == asked

    def test_every_rule_whose_stage_is_told_the_device_asks_for_a_card(self):
        told = {name for name, value in vars(stage_settings).items() if inspect.isfunction(value)}
        told = {name for name in told if '"device"' in inspect.getsource(getattr(stage_settings, name))} | {"flow"}
        text = "".join(path.read_text() for path in sorted((ROOT / "workflow" / "rules").glob("*.smk")))
        asking = {stage.key() for stage in planned.STUDIES.values() if stage.runs_models}
        for rule in re.split(r"^ *rule\b", text, flags=re.M)[1:]:
            if "gpu=GPUS" in rule:
                asking |= set(re.findall(r"stage_params\(\"(\w+)\"", rule.replace("training_of", '"train"')))
        assert asking == told

    def test_a_run_on_one_machine_has_one(self):
        assert "gpu=1" in yaml.safe_load((ROOT / "profiles" / "default" / "config.yaml").read_text())["resources"]


def test_what_windows_share_is_told_only_to_what_shares_it(base):
    methods = "methods: [mean, least_squares, least_squares_shared, truth, aphynity, alternating, alternating_shared]"
    none = "augmented: [], augmentations: {narrow: null, wide: null}, controls: [], flows: [], refined: [aphynity]"
    text = f"{{run: [pendulum], experiments: {{pendulum: {{UNITS {methods}, {none}}}}}}}"
    shared = text.replace("UNITS", "refinement: {units: {omega0: shared}},")
    each = text.replace("UNITS", "").replace("least_squares_shared, ", "").replace(", alternating_shared", "")
    with_units, without = (config.validate(config.merge(base, yaml.safe_load(one))) for one in (shared, each))
    jobs_of = {}
    for name, found in (("with", with_units), ("without", without)):
        jobs_of[name] = {
            (stage, *names): STAGES[stage].settings_of(found, *names)
            for stage, names in planned.plan(found)
            if stage in ("train", "alternate", "share", "evaluate", "validity", "dissipation")
        }
    sharing = {"least_squares_shared", "alternating_shared"}
    own = {key: one for key, one in jobs_of["with"].items() if not sharing & {*key}}
    changed = {key[0] for key, one in own.items() if one != jobs_of["without"][key]}
    assert not changed
    told = {key for key, one in jobs_of["with"].items() if '"omega0": "shared"' in one}
    stages = {"share": "least_squares_shared", "alternate": "alternating_shared"}
    assert told == {(stage, "pendulum", method, "seeds_0_1_2") for stage, method in stages.items()}


def test_null_that_takes_nothing_away_is_told(base):
    """A misspelt name would leave what it was to take away, in silence."""
    nulls = {"augmentations": {"narow": None}, "data": {"sets": {"idd": None}}}
    with pytest.raises(InputErrors) as refused:
        config.validate(config.merge(base, {"experiments": {"pendulum": nulls}}))
    told = "\n".join(str(error) for error in refused.value.errors)
    for name, meant in (("augmentations.narow", "narrow"), ("data.sets.idd", "iid")):
        assert re.search(
            rf"pendulum\.{name}: null, where there is nothing of that name; did you mean '{meant}'\?", told
        )
    inherited = {"based_on": "pendulum", "augmentations": {"narrow": None}}
    more = config.merge(base, {"experiments": {"other": inherited}})
    assert "narrow" not in config.validate(more).experiments["other"].augmentations


@pytest.mark.parametrize("twice", [False, True])
def test_null_in_two_layers_takes_away_once(base, twice):
    removed = {"augmentations": {"narrow": None}}
    layers = config.merge(base, {"experiments": {"pendulum": removed}})
    if twice:
        layers = config.merge(layers, {"experiments": {"pendulum": removed}})
    assert "narrow" not in config.validate(layers).experiments["pendulum"].augmentations
