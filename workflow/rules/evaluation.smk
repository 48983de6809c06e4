# Metrics of every model, then the tables and figures of each experiment and of all.


rule evaluate_seed_group:
    input:
        model=trained_model,
        sets=lambda w: sets(w.experiment, CONFIG.experiments[w.experiment].data.set_names),
        prior=prior,
    output:
        metrics=results("{experiment}/{variant}/{seed_group}/metrics.csv"),
        forecasts=results("{experiment}/{variant}/{seed_group}/forecasts.npz"),
    log:
        results("logs/evaluate/{experiment}_{variant}_{seed_group}.log"),
    resources:
        mem_mb=4000,
        gpu=GPUS,
    params:
        **stage_params("evaluate", "experiment", "variant", "seed_group"),
        data=folder("{experiment}/data"),
        prior=option("prior"),
    message:
        "evaluate {wildcards.variant} on {wildcards.experiment}, {wildcards.seed_group}"
    shell:
        command("evaluate", "input.model params.data output.metrics output.forecasts params.prior")


rule log_evaluations_of_experiment:
    input:
        forecasts=of_versions("forecasts.npz", FILES.variants),
        tracking=ancient(results("mlflow/tracking.json")),
    output:
        results("{experiment}/evaluations.json"),
    log:
        results("logs/log_evaluations/{experiment}.log"),
    resources:
        mem_mb=2000,
    params:
        software=software("log_evaluations"),
    message:
        "draw and store each evaluation of {wildcards.experiment}"
    shell:
        command("log_evaluations", "input.forecasts output input.tracking")


rule tabulate_experiment:
    input:
        metrics=of_versions("metrics.csv"),
        forecasts=of_versions("forecasts.npz"),
    output:
        results("tables/{experiment}_long.csv"),
        table("{experiment}", "table", "{experiment}", "Tables", experiment="{experiment}"),
    log:
        results("logs/tabulate/{experiment}.log"),
    resources:
        mem_mb=1000,
    params:
        **stage_params("tabulate", "experiment"),
    message:
        "tabulate {wildcards.experiment}"
    shell:
        command("tabulate", "input.metrics input.forecasts output")


rule plot_experiment:
    input:
        table=results("tables/{experiment}_long.csv"),
        forecasts=of_versions("forecasts.npz"),
        models=of_versions("model.safetensors", FILES.logged),
    output:
        [figure_of_experiment(name, title) for name, title in FIGURES.items()],
    log:
        results("logs/plot/{experiment}.log"),
    resources:
        mem_mb=2000,
    params:
        **stage_params("plot", "experiment"),
        # A training's log is no declared output: a killed job would lose it.
        logs=of_versions("log.jsonl", FILES.logged),
        forecasts=lambda w, input: [
            path for path in input.forecasts if f"/{FILES.seed_groups(w.experiment)[0]}/" in path
        ],
        prefix=folder("figures/{experiment}"),
    message:
        "plot {wildcards.experiment}"
    shell:
        command("plot", "input.table params.forecasts params.logs params.prefix")


rule compare_experiment:
    input:
        metrics=of_versions("metrics.csv"),
        forecasts=of_versions("forecasts.npz"),
        published=os.path.relpath(PUBLISHED),
    output:
        expand(results("tables/{{experiment}}_published.{end}"), end=products.TABLE_ENDS),
    log:
        results("logs/compare/{experiment}.log"),
    wildcard_constraints:
        experiment=one_of(COMPARED),
    resources:
        mem_mb=1000,
    params:
        **stage_params("compare", lambda w: [w.experiment]),
    message:
        "compare {wildcards.experiment} with the published numbers"
    shell:
        command("compare", "input.metrics input.forecasts output")


if COMPARED:

    # The same over all experiments of the run.
    use rule compare_experiment as compare_all with:
        input:
            metrics=[FILES.of_versions(e, FILES.compared(e), "metrics.csv") for e in COMPARED],
            forecasts=[FILES.of_versions(e, FILES.compared(e), "forecasts.npz") for e in COMPARED],
            published=os.path.relpath(PUBLISHED),
        output:
            table("published", "published", "published numbers", "Tables", content="published numbers"),
        log:
            results("logs/compare.log"),
        params:
            **stage_params("compare", lambda w: COMPARED),
        message:
            "compare all experiments with the published numbers"


if OVERVIEWS:

    rule plot_overview:
        input:
            tables=[results(f"tables/{e['name']}_long.csv") for e in OVERVIEW],
        output:
            [overview_figure(name, title) for name, title in OVERVIEWS.items()],
        log:
            results("logs/plot_overview.log"),
        resources:
            mem_mb=1000,
        params:
            **stage_params("overview", lambda w: RUN),
            folder=folder("figures"),
        message:
            "plot all experiments"
        shell:
            command("overview", "input.tables params.folder")
