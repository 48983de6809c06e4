# Metrics of every model, then the tables and figures of each experiment.


rule evaluate_block:
    input:
        model=results("{experiment}/{variant}/{block}/model.safetensors"),
        sets=expand(results("{{experiment}}/data/{set}.npz"), set=EVALUATED_SETS),
        tracking=ancient(results("mlflow/tracking.json")),
        code=lambda w: code("evaluate", w.experiment, w.variant.removesuffix("+")),
        constraints=CONSTRAINTS,
    output:
        metrics=results("{experiment}/{variant}/{block}/metrics.csv"),
        forecasts=results("{experiment}/{variant}/{block}/forecasts.npz"),
        figures=[results(f"{{experiment}}/{{variant}}/{{block}}/{name}.png") for name in ("forecasts", "parameters")],
    log:
        results("logs/evaluate/{experiment}_{variant}_{block}.log"),
    benchmark:
        results("benchmarks/evaluate/{experiment}_{variant}_{block}.tsv")
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=4000,
    params:
        settings=lambda w: settings("evaluate", w.experiment, w.variant, w.block),
        data=lambda w: results(f"{w.experiment}/data"),
    message:
        "evaluate {wildcards.variant} on {wildcards.experiment}, {wildcards.block}"
    shell:
        "expertaug evaluate --model {input.model:q} --data {params.data:q} --output {output.metrics:q}"
        " --forecasts {output.forecasts:q} --settings {params.settings:q} --tracking {input.tracking:q} --log {log:q}"


rule tabulate_experiment:
    input:
        metrics=lambda w: per_block("metrics.csv", w.experiment, slices.variants(CONFIG, w.experiment)),
        forecasts=lambda w: per_block("forecasts.npz", w.experiment, slices.variants(CONFIG, w.experiment)),
        code=code("tabulate"),
        constraints=CONSTRAINTS,
    output:
        results("tables/{experiment}.csv"),
        results("tables/{experiment}_long.csv"),
        results("tables/{experiment}.tex"),
        report(
            results("tables/{experiment}.md"),
            caption="../report/table.rst",
            category="Tables",
            labels={"experiment": "{experiment}"},
        ),
    log:
        results("logs/tabulate/{experiment}.log"),
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        settings=lambda w: settings("tabulate", w.experiment),
    message:
        "tabulate {wildcards.experiment}"
    shell:
        "expertaug tabulate {input.metrics:q} --forecasts {input.forecasts:q} --output {output:q}"
        " --settings {params.settings:q} --log {log:q}"


rule plot_experiment:
    input:
        metrics=lambda w: per_block("metrics.csv", w.experiment, slices.variants(CONFIG, w.experiment)),
        forecasts=lambda w: per_block("forecasts.npz", w.experiment, slices.variants(CONFIG, w.experiment)),
        models=lambda w: per_block("model.safetensors", w.experiment, trained_of(w.experiment)),
        code=code("plot"),
        constraints=CONSTRAINTS,
    output:
        report(
            results("figures/{experiment}_log_mse.png"),
            caption="../report/log_mse.rst",
            category="Figures",
            subcategory="{experiment}",
            labels={"content": "log-MSE"},
        ),
        report(
            results("figures/{experiment}_parameter_errors.png"),
            caption="../report/parameter_errors.rst",
            category="Figures",
            subcategory="{experiment}",
            labels={"content": "parameter errors"},
        ),
        report(
            results("figures/{experiment}_parameters.png"),
            caption="../report/parameters.rst",
            category="Figures",
            subcategory="{experiment}",
            labels={"content": "estimated parameters"},
        ),
        report(
            results("figures/{experiment}_forecasts.png"),
            caption="../report/forecasts.rst",
            category="Figures",
            subcategory="{experiment}",
            labels={"content": "forecasts"},
        ),
        report(
            results("figures/{experiment}_curves.png"),
            caption="../report/curves.rst",
            category="Figures",
            subcategory="{experiment}",
            labels={"content": "trainings"},
        ),
        expand(results("figures/{{experiment}}_{figure}.pdf"), figure=FIGURES),
    log:
        results("logs/plot/{experiment}.log"),
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=2000,
    params:
        settings=lambda w: settings("plot", w.experiment),
        # A training's log is no declared output: a killed job would lose it.
        logs=lambda w: per_block("log.jsonl", w.experiment, trained_of(w.experiment)),
        forecasts=lambda w, input: [path for path in input.forecasts if f"/{BLOCKS[0]}/" in path],
        prefix=lambda w: results(f"figures/{w.experiment}"),
    message:
        "plot {wildcards.experiment}"
    shell:
        "expertaug plot {input.metrics:q} --forecasts {params.forecasts:q} --logs {params.logs:q}"
        " --output {params.prefix:q} --settings {params.settings:q} --log {log:q}"


# Targets: `snakemake --cores 2 NAME`.


rule evaluate:
    input:
        [per_block("metrics.csv", experiment, slices.variants(CONFIG, experiment)) for experiment in RUN],


rule report:
    input:
        ALL,


for name in RUN:

    # Everything of one experiment.
    rule:
        name:
            name
        input:
            tables_of(name),
            figures_of(name),
