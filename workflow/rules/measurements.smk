# Sets of measurements of one's own: tables, cut into chunks.


def checksums(wildcards):
    return CONFIG.experiments[wildcards.experiment].data.files.checksums or []


rule cut_measurements_of_experiment:
    input:
        files=lambda w: MEASURED[w.experiment],
        checksums=checksums,
        code=code("cut_measurements"),
    output:
        sets("{experiment}", MAIN_SETS),
        chunks=results("{experiment}/data/chunks.csv"),
        splits=results("{experiment}/data/splits.json"),
    log:
        results("logs/cut_measurements/{experiment}.log"),
    benchmark:
        results("benchmarks/cut_measurements/{experiment}.tsv")
    wildcard_constraints:
        experiment=one_of(MEASURED),
    conda:
        "../envs/expertaug.yaml"
    resources:
        mem_mb=3000,
    params:
        **stage_params("cut_measurements", "experiment"),
        folder=results("{experiment}/data"),
    message:
        "cut the measurements of {wildcards.experiment} into chunks"
    shell:
        "expertaug cut-measurements {input.files:q} --output {params.folder:q} --settings {params.settings:q} --log {log:q}"


# Longer chunks of the same points, which are evaluated alone.
rule cut_horizon_of_measurements:
    input:
        files=lambda w: MEASURED[w.experiment],
        checksums=checksums,
        code=code("cut_measured_horizon"),
    output:
        results("{experiment}/data/{set}.npz"),
    log:
        results("logs/cut_horizon/{experiment}_{set}.log"),
    wildcard_constraints:
        experiment=one_of(MEASURED),
        set=one_of({name for e in MEASURED for name in CONFIG.experiments[e].data.horizons}),
    conda:
        "../envs/expertaug.yaml"
    resources:
        mem_mb=3000,
    params:
        **stage_params("cut_measured_horizon", "experiment", "set"),
    message:
        "cut the chunks of {wildcards.set} for {wildcards.experiment}"
    shell:
        "expertaug cut-measured-horizon {input.files:q} --output {output:q} --settings {params.settings:q} --log {log:q}"
