# Studies of experiments: a rule for each that the products register (src/expertaug/evaluation/products.py).


def study_outputs(study):
    """Its table and, if it has one, its figure."""
    title = STUDIES[study].title or study
    shown_as = {"caption": study, "title": title.replace("_", " "), "category": "Studies"}
    labels = {"subcategory": "{experiment}", "study": title}
    files = table(f"{{experiment}}_{study}", content="table", **shown_as, **labels)
    if study in DRAWN:
        files += figure(f"{{experiment}}_{study}", content="figure", **shown_as, **labels)
    return files


def study_inputs(study):
    return lambda wildcards: STUDIES[study].inputs(FILES, wildcards.experiment, study)


def study_sets(study):
    return lambda wildcards: STUDIES[study].sets(FILES, wildcards.experiment)


def study_params(study):
    stage = STUDIES[study]

    def settings(wildcards):
        return stage.settings_of(CONFIG, *stage.names(wildcards.experiment, study))

    return {"stage": stage.name, "versions": versions(stage.key()), "settings": settings}


def study_log(study):
    return STUDIES[study].log.replace("{study}", study)


def with_study(study):
    """A wildcard's constraint: experiments that have it."""
    return one_of([experiment for experiment in RUN if study in studies_of(experiment)])


for study in [name for name in STUDIES if not STUDIES[name].runs_models]:

    rule:
        name:
            f"{study}_of_experiment"
        input:
            files=study_inputs(study),
            code=code(STUDIES[study].key()),
        output:
            study_outputs(study),
        log:
            results(f"logs/{study_log(study)}.log"),
        wildcard_constraints:
            experiment=with_study(study),
        conda:
            "../envs/expertaug.yaml"
        resources:
            mem_mb=STUDIES[study].memory_mb,
        params:
            **study_params(study),
        message:
            f"study {study} of {{wildcards.experiment}}"
        shell:
            "expertaug {params.stage} {input.files:q} --output {output:q} --settings {params.settings:q} --log {log:q}"


# Those that run models on sets: on the card, and what they cost is measured.
for study in [name for name in STUDIES if STUDIES[name].runs_models]:

    rule:
        name:
            f"{study}_of_experiment"
        input:
            models=study_inputs(study),
            sets=study_sets(study),
            code=code(STUDIES[study].key()),
        output:
            study_outputs(study),
        log:
            results(f"logs/{study_log(study)}.log"),
        benchmark:
            results(f"benchmarks/{study_log(study)}.tsv")
        wildcard_constraints:
            experiment=with_study(study),
        conda:
            "../envs/expertaug.yaml"
        resources:
            mem_mb=STUDIES[study].memory_mb,
            gpu=GPUS,
        params:
            **study_params(study),
            data=results("{experiment}/data"),
        message:
            f"study {study} of {{wildcards.experiment}}"
        shell:
            "expertaug {params.stage} {input.models:q} --data {params.data:q} --output {output:q}"
            " --settings {params.settings:q} --log {log:q}"
