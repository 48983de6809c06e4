# Studies of experiments: a rule for each that a stage makes (src/expertaug/stages/evaluation.py).
# Those of a kind take the same. A shell is read again when its job starts, after the loop: the stage is a parameter.


for study in [name for name in STUDIES if not STUDIES[name].runs_models]:

    rule:
        name:
            f"{study}_of_experiment"
        input:
            files=study_inputs(study),
        output:
            study_outputs(study),
        log:
            results(f"logs/{study_log(study)}.log"),
        wildcard_constraints:
            experiment=with_study(study),
        resources:
            mem_mb=STUDIES[study].memory_mb,
        params:
            **study_params(study),
        message:
            f"study {study} of {{wildcards.experiment}}"
        shell:
            command(STUDIES["seeds"].key(), "input.files output", name="{params.stage}")


# Those that run models on sets: on the card, and what they cost is measured.
for study in [name for name in STUDIES if STUDIES[name].runs_models]:

    rule:
        name:
            f"{study}_of_experiment"
        input:
            models=study_inputs(study),
            sets=study_sets(study),
        output:
            study_outputs(study),
        log:
            results(f"logs/{study_log(study)}.log"),
        wildcard_constraints:
            experiment=with_study(study),
        resources:
            mem_mb=STUDIES[study].memory_mb,
            gpu=GPUS,
        params:
            **study_params(study),
            data=folder("{experiment}/data"),
        message:
            f"study {study} of {{wildcards.experiment}}"
        shell:
            command(STUDIES["validity"].key(), "input.models params.data output", name="{params.stage}")
