# Training, augmentation and fine-tuning of blocks of seeds.


rule init_tracking:
    input:
        code=code("init_tracking"),
        constraints=CONSTRAINTS,
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
        settings=lambda w: settings("init_tracking"),
    message:
        "prepare the tracking store"
    shell:
        "expertaug init-tracking --output {output:q} --settings {params.settings:q} --log {log:q}"


rule train_block:
    input:
        train=results("{experiment}/data/train.npz"),
        validation=results("{experiment}/data/validation.npz"),
        calibration=lambda w: calibration_of(w.experiment),
        tracking=ancient(results("mlflow/tracking.json")),
        code=lambda w: code("train", w.experiment, w.method),
        constraints=CONSTRAINTS,
    output:
        results("{experiment}/{method}/{block}/model.safetensors"),
    log:
        results("logs/train/{experiment}_{method}_{block}.log"),
    benchmark:
        results("benchmarks/train/{experiment}_{method}_{block}.tsv")
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=4000,
    params:
        settings=lambda w: settings("train", w.experiment, w.method, w.block),
        data=lambda w: results(f"{w.experiment}/data"),
        work=lambda w: results(f".work/{w.experiment}/{w.method}/{w.block}"),
        calibration=lambda w, input: f"--calibration {shlex.quote(str(input.calibration))}" if input.calibration else "",
    message:
        "train {wildcards.method} on {wildcards.experiment}, {wildcards.block}"
    shell:
        "expertaug train --data {params.data:q} {params.calibration} --output {output:q} --work {params.work:q}"
        " --settings {params.settings:q} --tracking {input.tracking:q} --log {log:q}"


rule augment_block:
    input:
        model=results("{experiment}/{method}/{block}/model.safetensors"),
        train=results("{experiment}/data/train.npz"),
        validation=results("{experiment}/data/validation.npz"),
        code=lambda w: code("augment", w.experiment, w.method),
        constraints=CONSTRAINTS,
    output:
        results("{experiment}/{method}+/{block}/augmented.safetensors"),
    log:
        results("logs/augment/{experiment}_{method}_{block}.log"),
    benchmark:
        results("benchmarks/augment/{experiment}_{method}_{block}.tsv")
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=4000,
    params:
        settings=lambda w: settings("augment", w.experiment, w.method, w.block),
        data=lambda w: results(f"{w.experiment}/data"),
    message:
        "augment the data of {wildcards.experiment} by {wildcards.method}, {wildcards.block}"
    shell:
        "expertaug augment --model {input.model:q} --data {params.data:q} --output {output:q}"
        " --settings {params.settings:q} --log {log:q}"


rule finetune_block:
    input:
        model=results("{experiment}/{method}/{block}/model.safetensors"),
        augmented=results("{experiment}/{method}+/{block}/augmented.safetensors"),
        train=results("{experiment}/data/train.npz"),
        validation=results("{experiment}/data/validation.npz"),
        tracking=ancient(results("mlflow/tracking.json")),
        code=lambda w: code("finetune", w.experiment, w.method),
        constraints=CONSTRAINTS,
    output:
        results("{experiment}/{method}+/{block}/model.safetensors"),
    log:
        results("logs/finetune/{experiment}_{method}_{block}.log"),
    benchmark:
        results("benchmarks/finetune/{experiment}_{method}_{block}.tsv")
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=4000,
    params:
        settings=lambda w: settings("finetune", w.experiment, w.method, w.block),
        data=lambda w: results(f"{w.experiment}/data"),
        work=lambda w: results(f".work/{w.experiment}/{w.method}+/{w.block}"),
    message:
        "fine-tune {wildcards.method} on {wildcards.experiment}, {wildcards.block}"
    shell:
        "expertaug finetune --model {input.model:q} --augmented {input.augmented:q} --data {params.data:q}"
        " --output {output:q} --work {params.work:q} --settings {params.settings:q}"
        " --tracking {input.tracking:q} --log {log:q}"


# Targets: `snakemake --cores 2 NAME`.


rule train:
    input:
        [per_block("model.safetensors", experiment, methods_of(experiment)) for experiment in RUN],


rule augment:
    input:
        [
            per_block("augmented.safetensors", experiment, [f"{m}+" for m in augmented_of(experiment)])
            for experiment in RUN
        ],


rule finetune:
    input:
        [per_block("model.safetensors", experiment, [f"{m}+" for m in augmented_of(experiment)]) for experiment in RUN],
