# Simulated sets.


rule simulate_set:
    input:
        code=code("simulate"),
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
    resources:
        mem_mb=2000,
    params:
        **stage_params("simulate", "experiment", "set"),
    message:
        "simulate the {wildcards.set} set of {wildcards.experiment}"
    shell:
        "expertaug simulate {wildcards.set} --output {output:q} --settings {params.settings:q} --log {log:q}"
