# Sets: simulated, or chunks cut out of recordings and of measurements of one's own.


rule simulate_set:
    output:
        results("{experiment}/data/{set}.npz"),
    log:
        results("logs/simulate/{experiment}_{set}.log"),
    wildcard_constraints:
        experiment=one_of(SIMULATED),
    resources:
        mem_mb=2000,
    params:
        **stage_params("simulate", "experiment", "set"),
    message:
        "simulate the {wildcards.set} set of {wildcards.experiment}"
    shell:
        command("simulate", "wildcards.set output")


rule split_chunks_of_experiment:
    input:
        angles=lambda w: of_recordings("angles.csv"),
    output:
        sets("{experiment}", MAIN_SETS),
        chunks=results("{experiment}/data/chunks.csv"),
        splits=results("{experiment}/data/splits.json"),
    log:
        results("logs/split_chunks/{experiment}.log"),
    wildcard_constraints:
        experiment=one_of(RECORDED),
    resources:
        mem_mb=3000,
    params:
        **stage_params("split_chunks", "experiment"),
        folder=folder("{experiment}/data"),
    message:
        "split the recordings into chunks for {wildcards.experiment}"
    shell:
        command("split_chunks", "input.angles params.folder")


rule plot_splits_of_experiment:
    input:
        sets=sets("{experiment}", MAIN_SETS),
        chunks=results("{experiment}/data/chunks.csv"),
        splits=results("{experiment}/data/splits.json"),
    output:
        figure("{experiment}_splits", "splits", "splits of {experiment}", "Recordings"),
    log:
        results("logs/plot_splits/{experiment}.log"),
    wildcard_constraints:
        experiment=one_of(RECORDED),
    resources:
        mem_mb=2000,
    params:
        software=software("plot_splits"),
        data=folder("{experiment}/data"),
    message:
        "draw the splits of {wildcards.experiment}"
    shell:
        command("plot_splits", "params.data output")


rule cut_measurements_of_experiment:
    input:
        files=lambda w: MEASURED[w.experiment],
        checksums=checksums,
    output:
        sets("{experiment}", MAIN_SETS),
        chunks=results("{experiment}/data/chunks.csv"),
        splits=results("{experiment}/data/splits.json"),
    log:
        results("logs/cut_measurements/{experiment}.log"),
    wildcard_constraints:
        experiment=one_of(MEASURED),
    resources:
        mem_mb=3000,
    params:
        **stage_params("cut_measurements", "experiment"),
        folder=folder("{experiment}/data"),
    message:
        "cut the measurements of {wildcards.experiment} into chunks"
    shell:
        command("cut_measurements", "input.files params.folder")


# Longer chunks of the same frames or rows, which are evaluated alone.
rule cut_horizon_of_experiment:
    input:
        files=lambda w: MEASURED[w.experiment] if w.experiment in MEASURED else of_recordings("angles.csv"),
        checksums=checksums,
    output:
        results("{experiment}/data/{set}.npz"),
    log:
        results("logs/cut_horizon/{experiment}_{set}.log"),
    wildcard_constraints:
        experiment=one_of([*RECORDED, *MEASURED]),
        set=one_of({name for e in [*RECORDED, *MEASURED] for name in CONFIG.experiments[e].data.horizons}),
    resources:
        mem_mb=3000,
    params:
        **stage_params(horizon_stage, "experiment", "set"),
        stage=lambda w: STAGES[horizon_stage(w)].name,
    message:
        "cut the chunks of {wildcards.set} for {wildcards.experiment}"
    shell:
        command("cut_horizon", "input.files output", name="{params.stage}")


rule calibrate_experiment:
    input:
        train=results("{experiment}/data/train.npz"),
    output:
        results("{experiment}/data/calibration.json"),
    log:
        results("logs/calibrate/{experiment}.log"),
    wildcard_constraints:
        experiment=one_of(RECORDED + list(MEASURED)),
    resources:
        mem_mb=2000,
    params:
        **stage_params("calibrate", "experiment"),
    message:
        "calibrate the expert of {wildcards.experiment}"
    shell:
        command("calibrate", "input.train output")
