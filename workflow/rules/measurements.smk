# Measurements of one's own: tables, cut into chunks.


rule cut_measurements_of_experiment:
    input:
        files=lambda w: MEASURED[w.experiment],
        checksums=lambda w: CONFIG.experiments[w.experiment].data.files.checksums or [],
        code=lambda w: code("cut_measurements", w.experiment),
    output:
        expand(results("{{experiment}}/data/{set}.npz"), set=MAIN_SETS),
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
    threads: 1
    resources:
        mem_mb=3000,
    params:
        versions=lambda w: versions("cut_measurements", w.experiment),
        settings=lambda w: settings("cut_measurements", w.experiment),
        folder=lambda w: results(f"{w.experiment}/data"),
    message:
        "cut the measurements of {wildcards.experiment} into chunks"
    shell:
        "expertaug cut-measurements {input.files:q} --output {params.folder:q} --settings {params.settings:q} --log {log:q}"


# Longer chunks of the same points, which are evaluated alone.
rule cut_horizon_of_measurements:
    input:
        files=lambda w: MEASURED[w.experiment],
        checksums=lambda w: CONFIG.experiments[w.experiment].data.files.checksums or [],
        code=lambda w: code("cut_measured_horizon", w.experiment),
    output:
        results("{experiment}/data/{set}.npz"),
    log:
        results("logs/cut_horizon/{experiment}_{set}.log"),
    wildcard_constraints:
        experiment=one_of(MEASURED),
        set=one_of({name for e in MEASURED for name in jobs.horizons(CONFIG, e)}),
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=3000,
    params:
        versions=lambda w: versions("cut_measured_horizon", w.experiment),
        settings=lambda w: settings("cut_measured_horizon", w.experiment, w.set),
    message:
        "cut the chunks of {wildcards.set} for {wildcards.experiment}"
    shell:
        "expertaug cut-measured-horizon {input.files:q} --output {output:q} --settings {params.settings:q} --log {log:q}"


rule cut_measurements:
    input:
        and_before([results(f"{experiment}/data/{name}.npz") for experiment in MEASURED for name in MAIN_SETS]),
