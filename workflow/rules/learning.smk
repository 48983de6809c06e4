# Training, augmentation and fine-tuning of groups of seeds.


rule init_tracking:
    input:
        code=code("init_tracking"),
    output:
        results("mlflow/tracking.json"),
    log:
        results("logs/init_tracking.log"),
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        versions=versions("init_tracking"),
        settings=lambda w: settings("init_tracking"),
    message:
        "prepare the tracking store"
    shell:
        "expertaug init-tracking --output {output:q} --settings {params.settings:q} --log {log:q}"


rule train_seed_group:
    input:
        train=results("{experiment}/data/train.npz"),
        validation=results("{experiment}/data/validation.npz"),
        calibration=lambda w: calibration_of(w.experiment),
        tracking=ancient(results("mlflow/tracking.json")),
        prior=lambda w: prior_to_train(w.experiment, w.method),
        code=lambda w: code(training_of(w.method), w.experiment, w.method),
    output:
        model=results("{experiment}/{method}/{seed_group}/model.safetensors"),
        # States at several of its stages, for the study during_training; an empty file where no study follows it.
        snapshots=touch(results("{experiment}/{method}/{seed_group}/snapshots.safetensors")),
    log:
        results("logs/train/{experiment}_{method}_{seed_group}.log"),
    benchmark:
        results("benchmarks/train/{experiment}_{method}_{seed_group}.tsv")
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        gpu=GPUS,
    params:
        versions=lambda w: versions(training_of(w.method), w.experiment, w.method),
        settings=lambda w: settings("train", w.experiment, w.method, w.seed_group),
        data=lambda w: results(f"{w.experiment}/data"),
        work=lambda w: results(f".work/{w.experiment}/{w.method}/{w.seed_group}"),
        calibration=lambda w, input: f"--calibration {shlex.quote(str(input.calibration))}" if input.calibration else "",
        stage=lambda w: training_of(w.method),
        prior=lambda w, input: prior_option(input),
    message:
        "train {wildcards.method} on {wildcards.experiment}, {wildcards.seed_group}"
    shell:
        "expertaug {params.stage} --data {params.data:q} {params.calibration} --output {output.model:q} --work {params.work:q}"
        " {params.prior} --settings {params.settings:q} --tracking {input.tracking:q} --log {log:q}"


rule during_training_seed_group:
    input:
        snapshots=results("{experiment}/{method}/{seed_group}/snapshots.safetensors"),
        sets=expand(results("{{experiment}}/data/{set}.npz"), set=MAIN_SETS),
        tracking=ancient(results("mlflow/tracking.json")),
        prior=lambda w: prior_file(w.experiment, f"{w.method}+", w.seed_group),
        code=lambda w: code("during_training", w.experiment, w.method),
    output:
        results("{experiment}/{method}/{seed_group}/during_training.csv"),
    log:
        results("logs/during_training/{experiment}_{method}_{seed_group}.log"),
    benchmark:
        results("benchmarks/during_training/{experiment}_{method}_{seed_group}.tsv")
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        gpu=GPUS,
    params:
        versions=lambda w: versions("during_training", w.experiment, w.method),
        settings=lambda w: settings("during_training", w.experiment, w.method, w.seed_group),
        data=lambda w: results(f"{w.experiment}/data"),
        work=lambda w: results(f".work/{w.experiment}/{w.method}/{w.seed_group}_during_training"),
        prior=lambda w, input: prior_option(input),
    message:
        "augment {wildcards.method} along its training on {wildcards.experiment}, {wildcards.seed_group}"
    shell:
        "expertaug during-training --snapshots {input.snapshots:q} --data {params.data:q} --output {output:q}"
        " --work {params.work:q} {params.prior} --settings {params.settings:q} --tracking {input.tracking:q} --log {log:q}"


rule own_prior_of_experiment:
    input:
        sets=lambda w: sets_to_cover(w.experiment, ""),
        calibration=lambda w: calibration_of(w.experiment),
        code=lambda w: code("own_prior", w.experiment),
    output:
        results("{experiment}/data/prior.json"),
    log:
        results("logs/own_prior/{experiment}.log"),
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=4000,
    params:
        versions=lambda w: versions("own_prior", w.experiment),
        settings=lambda w: settings("own_prior", w.experiment, "", None),
        data=lambda w: results(f"{w.experiment}/data"),
        calibration=lambda w, input: f"--calibration {shlex.quote(str(input.calibration))}" if input.calibration else "",
    message:
        "find the ranges of p⁺ on {wildcards.experiment}, before training"
    shell:
        "expertaug own-prior --data {params.data:q} {params.calibration} --output {output:q}"
        " --settings {params.settings:q} --log {log:q}"


rule own_prior_seed_group:
    input:
        model=lambda w: results(f"{w.experiment}/{method_of(w.variant)}/{w.seed_group}/model.safetensors"),
        sets=lambda w: sets_to_cover(w.experiment, w.variant),
        code=lambda w: code("own_prior", w.experiment, method_of(w.variant)),
    output:
        results("{experiment}/{variant}/{seed_group}/prior.json"),
    log:
        results("logs/own_prior/{experiment}_{variant}_{seed_group}.log"),
    benchmark:
        results("benchmarks/own_prior/{experiment}_{variant}_{seed_group}.tsv")
    wildcard_constraints:
        variant=FOUND_PRIORS,
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        gpu=GPUS,
    params:
        versions=lambda w: versions("own_prior", w.experiment, method_of(w.variant)),
        settings=lambda w: settings("own_prior", w.experiment, w.variant, w.seed_group),
        data=lambda w: results(f"{w.experiment}/data"),
    message:
        "find the ranges of p⁺ of {wildcards.variant} on {wildcards.experiment}, {wildcards.seed_group}"
    shell:
        "expertaug own-prior --model {input.model:q} --data {params.data:q} --output {output:q}"
        " --settings {params.settings:q} --log {log:q}"


rule augment_seed_group:
    input:
        model=lambda w: results(f"{w.experiment}/{method_of(w.variant)}/{w.seed_group}/model.safetensors"),
        train=results("{experiment}/data/train.npz"),
        validation=results("{experiment}/data/validation.npz"),
        prior=lambda w: prior_file(w.experiment, w.variant, w.seed_group),
        code=lambda w: code("augment", w.experiment, method_of(w.variant)),
    output:
        results("{experiment}/{variant}/{seed_group}/augmented.safetensors"),
    log:
        results("logs/augment/{experiment}_{variant}_{seed_group}.log"),
    benchmark:
        results("benchmarks/augment/{experiment}_{variant}_{seed_group}.tsv")
    wildcard_constraints:
        variant=AUGMENTED,
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        gpu=GPUS,
    params:
        versions=lambda w: versions("augment", w.experiment, method_of(w.variant)),
        settings=lambda w: settings("augment", w.experiment, w.variant, w.seed_group),
        data=lambda w: results(f"{w.experiment}/data"),
        prior=lambda w, input: prior_option(input),
    message:
        "augment the data of {wildcards.experiment} for {wildcards.variant}, {wildcards.seed_group}"
    shell:
        "expertaug augment --model {input.model:q} --data {params.data:q} --output {output:q}"
        " {params.prior} --settings {params.settings:q} --log {log:q}"


rule finetune_seed_group:
    input:
        model=lambda w: results(f"{w.experiment}/{method_of(w.variant)}/{w.seed_group}/model.safetensors"),
        augmented=lambda w: (
            results(f"{w.experiment}/{w.variant}/{w.seed_group}/augmented.safetensors")
            if Version.parse(w.variant).is_augmented
            else []
        ),
        train=results("{experiment}/data/train.npz"),
        validation=results("{experiment}/data/validation.npz"),
        tracking=ancient(results("mlflow/tracking.json")),
        prior=lambda w: prior_file(w.experiment, w.variant, w.seed_group),
        code=lambda w: code("finetune", w.experiment, method_of(w.variant)),
    output:
        results("{experiment}/{variant}/{seed_group}/model.safetensors"),
    log:
        results("logs/finetune/{experiment}_{variant}_{seed_group}.log"),
    benchmark:
        results("benchmarks/finetune/{experiment}_{variant}_{seed_group}.tsv")
    wildcard_constraints:
        variant=FINETUNED,
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        gpu=GPUS,
    params:
        versions=lambda w: versions("finetune", w.experiment, method_of(w.variant)),
        settings=lambda w: settings("finetune", w.experiment, w.variant, w.seed_group),
        data=lambda w: results(f"{w.experiment}/data"),
        work=lambda w: results(f".work/{w.experiment}/{w.variant}/{w.seed_group}"),
        augmented=lambda w, input: f"--augmented {shlex.quote(str(input.augmented))}" if input.augmented else "",
        prior=lambda w, input: prior_option(input),
    message:
        "fine-tune {wildcards.variant} on {wildcards.experiment}, {wildcards.seed_group}"
    shell:
        "expertaug finetune --model {input.model:q} {params.augmented} --data {params.data:q}"
        " --output {output:q} --work {params.work:q} {params.prior} --settings {params.settings:q}"
        " --tracking {input.tracking:q} --log {log:q}"


rule flow_seed_group:
    input:
        model=lambda w: results(f"{w.experiment}/{method_of(w.variant)}/{w.seed_group}/model.safetensors"),
        train=results("{experiment}/data/train.npz"),
        validation=results("{experiment}/data/validation.npz"),
        tracking=ancient(results("mlflow/tracking.json")),
        prior=lambda w: prior_file(w.experiment, w.variant, w.seed_group),
        code=lambda w: code("flow", w.experiment, method_of(w.variant)),
    output:
        results("{experiment}/{variant}/{seed_group}/model.safetensors"),
    log:
        results("logs/flow/{experiment}_{variant}_{seed_group}.log"),
    benchmark:
        results("benchmarks/flow/{experiment}_{variant}_{seed_group}.tsv")
    wildcard_constraints:
        variant=FLOWS,
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        gpu=GPUS,
    params:
        versions=lambda w: versions("flow", w.experiment, method_of(w.variant)),
        settings=lambda w: settings("flow", w.experiment, w.variant, w.seed_group),
        data=lambda w: results(f"{w.experiment}/data"),
        work=lambda w: results(f".work/{w.experiment}/{w.variant}/{w.seed_group}"),
        prior=lambda w, input: prior_option(input),
    message:
        "learn the posterior {wildcards.variant} on {wildcards.experiment}, {wildcards.seed_group}"
    shell:
        "expertaug flow --model {input.model:q} --data {params.data:q} --output {output:q} --work {params.work:q}"
        " {params.prior} --settings {params.settings:q} --tracking {input.tracking:q} --log {log:q}"


# Targets: `snakemake --cores 2 NAME`.


rule train:
    input:
        and_before([per_seed_group("model.safetensors", e, methods_of(e)) for e in RUN]),


rule augment:
    input:
        and_before([per_seed_group("augmented.safetensors", e, augmented_of(e)) for e in RUN]),


rule finetune:
    input:
        and_before([per_seed_group("model.safetensors", e, finetuned_of(e)) for e in RUN]),


rule flow:
    input:
        and_before([per_seed_group("model.safetensors", e, flows_of(e)) for e in RUN]),


rule during_training:
    input:
        and_before([during_training_of(e) for e in RUN]),
