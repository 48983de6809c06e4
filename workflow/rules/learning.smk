# Training, augmentation and fine-tuning of groups of seeds.


rule init_tracking:
    output:
        results("mlflow/tracking.json"),
    log:
        results("logs/init_tracking.log"),
    resources:
        mem_mb=1000,
    params:
        **stage_params("init_tracking"),
    message:
        "prepare the tracking store"
    shell:
        command("init_tracking", "output")


rule train_seed_group:
    input:
        sets=lambda w: sets(w.experiment, LEARNING_SETS),
        calibration=calibration,
        tracking=ancient(results("mlflow/tracking.json")),
        prior=lambda w: FILES.prior_to_train(w.experiment, w.method),
    output:
        model=results("{experiment}/{method}/{seed_group}/model.safetensors"),
        # States at several of its stages, for the study during_training; an empty file where no study follows it.
        snapshots=touch(results("{experiment}/{method}/{seed_group}/snapshots.safetensors")),
    log:
        results("logs/train/{experiment}_{method}_{seed_group}.log"),
    resources:
        mem_mb=4000,
        gpu=GPUS,
    params:
        **stage_params(training_of, "experiment", "method", "seed_group"),
        stage=training_of,
        data=folder("{experiment}/data"),
        work=folder(".work/{experiment}/{method}/{seed_group}"),
        calibration=option("calibration"),
        prior=option("prior"),
    message:
        "train {wildcards.method} on {wildcards.experiment}, {wildcards.seed_group}"
    shell:
        command(
            "train",
            "params.data output.model params.work input.tracking params.calibration params.prior",
            name="{params.stage}",
        )


rule during_training_seed_group:
    input:
        snapshots=results("{experiment}/{method}/{seed_group}/snapshots.safetensors"),
        sets=lambda w: sets(w.experiment, MAIN_SETS),
        tracking=ancient(results("mlflow/tracking.json")),
        prior=lambda w: FILES.prior(w.experiment, f"{w.method}+", w.seed_group),
    output:
        results("{experiment}/{method}/{seed_group}/during_training.csv"),
    log:
        results("logs/during_training/{experiment}_{method}_{seed_group}.log"),
    resources:
        mem_mb=4000,
        gpu=GPUS,
    params:
        **stage_params("during_training", "experiment", "method", "seed_group"),
        data=folder("{experiment}/data"),
        work=folder(".work/{experiment}/{method}/{seed_group}_during_training"),
        prior=option("prior"),
    message:
        "augment {wildcards.method} along its training on {wildcards.experiment}, {wildcards.seed_group}"
    shell:
        command("during_training", "input.snapshots params.data output params.work input.tracking params.prior")


rule own_prior_of_experiment:
    input:
        sets=lambda w: FILES.sets_to_cover(w.experiment),
        calibration=calibration,
    output:
        results("{experiment}/data/prior.json"),
    log:
        results("logs/own_prior/{experiment}.log"),
    resources:
        mem_mb=4000,
    params:
        **stage_params("own_prior", "experiment", lambda w: "", lambda w: None),
        data=folder("{experiment}/data"),
        calibration=option("calibration"),
    message:
        "find the ranges of p⁺ on {wildcards.experiment}, before training"
    shell:
        command("own_prior", "params.data output params.calibration")


rule own_prior_seed_group:
    input:
        model=base_model,
        sets=lambda w: FILES.sets_to_cover(w.experiment, w.variant),
    output:
        results("{experiment}/{variant}/{seed_group}/prior.json"),
    log:
        results("logs/own_prior/{experiment}_{variant}_{seed_group}.log"),
    wildcard_constraints:
        variant=one_of([v for e in RUN for v in FILES.found_priors(e)]),
    resources:
        mem_mb=4000,
        gpu=GPUS,
    params:
        **stage_params("own_prior", "experiment", "variant", "seed_group"),
        data=folder("{experiment}/data"),
    message:
        "find the ranges of p⁺ of {wildcards.variant} on {wildcards.experiment}, {wildcards.seed_group}"
    shell:
        command("own_prior", "input.model params.data output")


rule augment_seed_group:
    input:
        model=base_model,
        sets=lambda w: sets(w.experiment, LEARNING_SETS),
        prior=prior,
    output:
        results("{experiment}/{variant}/{seed_group}/augmented.safetensors"),
    log:
        results("logs/augment/{experiment}_{variant}_{seed_group}.log"),
    wildcard_constraints:
        variant=one_of([v for e in RUN for v in FILES.augmented(e)]),
    resources:
        mem_mb=4000,
        gpu=GPUS,
    params:
        **stage_params("augment", "experiment", "variant", "seed_group"),
        data=folder("{experiment}/data"),
        prior=option("prior"),
    message:
        "augment the data of {wildcards.experiment} for {wildcards.variant}, {wildcards.seed_group}"
    shell:
        command("augment", "input.model params.data output params.prior")


rule finetune_seed_group:
    input:
        model=base_model,
        augmented=lambda w: FILES.augmented_samples(w.experiment, w.variant, w.seed_group),
        sets=lambda w: sets(w.experiment, LEARNING_SETS),
        tracking=ancient(results("mlflow/tracking.json")),
        prior=prior,
    output:
        results("{experiment}/{variant}/{seed_group}/model.safetensors"),
    log:
        results("logs/finetune/{experiment}_{variant}_{seed_group}.log"),
    wildcard_constraints:
        variant=one_of([v for e in RUN for v in FILES.finetuned(e)]),
    resources:
        mem_mb=4000,
        gpu=GPUS,
    params:
        **stage_params("finetune", "experiment", "variant", "seed_group"),
        data=folder("{experiment}/data"),
        work=folder(".work/{experiment}/{variant}/{seed_group}"),
        augmented=option("augmented"),
        prior=option("prior"),
    message:
        "fine-tune {wildcards.variant} on {wildcards.experiment}, {wildcards.seed_group}"
    shell:
        command("finetune", "input.model params.data output params.work input.tracking params.augmented params.prior")


rule flow_seed_group:
    input:
        model=base_model,
        sets=lambda w: sets(w.experiment, LEARNING_SETS),
        tracking=ancient(results("mlflow/tracking.json")),
        prior=prior,
    output:
        results("{experiment}/{variant}/{seed_group}/model.safetensors"),
    log:
        results("logs/flow/{experiment}_{variant}_{seed_group}.log"),
    wildcard_constraints:
        variant=one_of([v for e in RUN for v in FILES.flows(e)]),
    resources:
        mem_mb=4000,
        gpu=GPUS,
    params:
        **stage_params("flow", "experiment", "variant", "seed_group"),
        data=folder("{experiment}/data"),
        work=folder(".work/{experiment}/{variant}/{seed_group}"),
        prior=option("prior"),
    message:
        "learn the posterior {wildcards.variant} on {wildcards.experiment}, {wildcards.seed_group}"
    shell:
        command("flow", "input.model params.data output params.work input.tracking params.prior")
