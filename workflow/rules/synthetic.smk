# Simulated sets.


rule simulate_set:
    input:
        code=lambda w: code("simulate", w.experiment),
    output:
        results("{experiment}/data/{set}.npz"),
    log:
        results("logs/simulate/{experiment}_{set}.log"),
    benchmark:
        results("benchmarks/simulate/{experiment}_{set}.tsv")
    wildcard_constraints:
        experiment=one_of(SIMULATED),
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=2000,
    params:
        versions=lambda w: versions("simulate", w.experiment),
        settings=lambda w: settings("simulate", w.experiment, w.set),
    message:
        "simulate the {wildcards.set} set of {wildcards.experiment}"
    shell:
        "expertaug simulate {wildcards.set} --output {output:q} --settings {params.settings:q} --log {log:q}"


rule simulate:
    input:
        [results(f"{experiment}/data/{name}.npz") for experiment in SIMULATED for name in sets_of(experiment)],
