# Metrics of every model, then the tables and figures of each experiment.


rule evaluate_seed_group:
    input:
        model=lambda w: results(f"{w.experiment}/{trained_as(w.variant)}/{w.seed_group}/model.safetensors"),
        sets=lambda w: expand(
            results("{experiment}/data/{set}.npz"), experiment=w.experiment, set=sets_of(w.experiment)
        ),
        prior=lambda w: prior_file(w.experiment, w.variant, w.seed_group),
        code=lambda w: code("evaluate", w.experiment, method_of(w.variant)),
    output:
        metrics=results("{experiment}/{variant}/{seed_group}/metrics.csv"),
        forecasts=results("{experiment}/{variant}/{seed_group}/forecasts.npz"),
    log:
        results("logs/evaluate/{experiment}_{variant}_{seed_group}.log"),
    benchmark:
        results("benchmarks/evaluate/{experiment}_{variant}_{seed_group}.tsv")
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        gpu=GPUS,
    params:
        versions=lambda w: versions("evaluate", w.experiment, method_of(w.variant)),
        settings=lambda w: settings("evaluate", w.experiment, w.variant, w.seed_group),
        data=lambda w: results(f"{w.experiment}/data"),
        prior=lambda w, input: prior_option(input),
    message:
        "evaluate {wildcards.variant} on {wildcards.experiment}, {wildcards.seed_group}"
    shell:
        "expertaug evaluate --model {input.model:q} --data {params.data:q} --output {output.metrics:q}"
        " --forecasts {output.forecasts:q} {params.prior} --settings {params.settings:q} --log {log:q}"


rule log_evaluations_of_experiment:
    input:
        forecasts=lambda w: per_seed_group("forecasts.npz", w.experiment, every_variant(w.experiment)),
        tracking=ancient(results("mlflow/tracking.json")),
        code=code("log_evaluations"),
    output:
        results("{experiment}/evaluations.json"),
    log:
        results("logs/log_evaluations/{experiment}.log"),
    benchmark:
        results("benchmarks/log_evaluations/{experiment}.tsv")
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=2000,
    params:
        versions=versions("log_evaluations"),
    message:
        "draw and store each evaluation of {wildcards.experiment}"
    shell:
        "expertaug log-evaluations {input.forecasts:q} --output {output:q} --tracking {input.tracking:q} --log {log:q}"


rule tabulate_experiment:
    input:
        metrics=lambda w: per_seed_group("metrics.csv", w.experiment, jobs.variants(CONFIG, w.experiment)),
        forecasts=lambda w: per_seed_group("forecasts.npz", w.experiment, jobs.variants(CONFIG, w.experiment)),
        code=code("tabulate"),
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
        versions=versions("tabulate"),
        settings=lambda w: settings("tabulate", w.experiment),
    message:
        "tabulate {wildcards.experiment}"
    shell:
        "expertaug tabulate {input.metrics:q} --forecasts {input.forecasts:q} --output {output:q}"
        " --settings {params.settings:q} --log {log:q}"


rule plot_experiment:
    input:
        metrics=lambda w: per_seed_group("metrics.csv", w.experiment, jobs.variants(CONFIG, w.experiment)),
        forecasts=lambda w: per_seed_group("forecasts.npz", w.experiment, jobs.variants(CONFIG, w.experiment)),
        models=lambda w: per_seed_group("model.safetensors", w.experiment, trained_of(w.experiment)),
        code=code("plot"),
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
        versions=versions("plot"),
        settings=lambda w: settings("plot", w.experiment),
        # A training's log is no declared output: a killed job would lose it.
        logs=lambda w: per_seed_group("log.jsonl", w.experiment, trained_of(w.experiment)),
        forecasts=lambda w, input: [path for path in input.forecasts if f"/{seed_groups_of(w.experiment)[0]}/" in path],
        prefix=lambda w: results(f"figures/{w.experiment}"),
    message:
        "plot {wildcards.experiment}"
    shell:
        "expertaug plot {input.metrics:q} --forecasts {params.forecasts:q} --logs {params.logs:q}"
        " --output {params.prefix:q} --settings {params.settings:q} --log {log:q}"


rule study_experiment:
    input:
        metrics=lambda w: studied(w.experiment, w.study),
        code=code("study"),
    output:
        results("tables/{experiment}_{study}.csv"),
        results("tables/{experiment}_{study}.tex"),
        report(
            results("tables/{experiment}_{study}.md"),
            caption="../report/study.rst",
            category="Studies",
            subcategory="{experiment}",
            labels={"study": "{study}", "content": "table"},
        ),
        report(
            results("figures/{experiment}_{study}.png"),
            caption="../report/study.rst",
            category="Studies",
            subcategory="{experiment}",
            labels={"study": "{study}", "content": "figure"},
        ),
        results("figures/{experiment}_{study}.pdf"),
    log:
        results("logs/study/{experiment}_{study}.log"),
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        versions=versions("study"),
        settings=lambda w: settings("study", w.experiment, w.study),
    message:
        "study {wildcards.study} of {wildcards.experiment}"
    shell:
        "expertaug study {input.metrics:q} --output {output:q} --settings {params.settings:q} --log {log:q}"


rule study_windows_of_experiment:
    input:
        forecasts=lambda w: per_seed_group("forecasts.npz", w.experiment, jobs.variants(CONFIG, w.experiment)),
        code=lambda w: code(w.window_study),
    output:
        results("tables/{experiment}_{window_study}.csv"),
        results("tables/{experiment}_{window_study}.tex"),
        report(
            results("tables/{experiment}_{window_study}.md"),
            caption="../report/windows.rst",
            category="Studies",
            subcategory="{experiment}",
            labels={"study": "{window_study}", "content": "table"},
        ),
        report(
            results("figures/{experiment}_{window_study}.png"),
            caption="../report/windows.rst",
            category="Studies",
            subcategory="{experiment}",
            labels={"study": "{window_study}", "content": "figure"},
        ),
        results("figures/{experiment}_{window_study}.pdf"),
    log:
        results("logs/study/{experiment}_{window_study}.log"),
    wildcard_constraints:
        window_study="alarm|coverage|distance",
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        versions=lambda w: versions(w.window_study),
        settings=lambda w: settings(w.window_study, w.experiment),
    message:
        "study {wildcards.window_study} of {wildcards.experiment}"
    shell:
        "expertaug {wildcards.window_study} {input.forecasts:q} --output {output:q} --settings {params.settings:q}"
        " --log {log:q}"


rule validity_of_experiment:
    input:
        models=lambda w: [
            results(f"{w.experiment}/{method}/{seed_groups_of(w.experiment)[0]}/model.safetensors")
            for method in jobs.checked(CONFIG, w.experiment)
        ],
        sets=lambda w: expand(
            results("{experiment}/data/{set}.npz"), experiment=w.experiment, set=sets_to_check(w.experiment)
        ),
        code=lambda w: code("validity", w.experiment),
    output:
        results("tables/{experiment}_validity.csv"),
        results("tables/{experiment}_validity.tex"),
        report(
            results("tables/{experiment}_validity.md"),
            caption="../report/validity.rst",
            category="Studies",
            subcategory="{experiment}",
            labels={"study": "validity of F_a", "content": "table"},
        ),
        report(
            results("figures/{experiment}_validity.png"),
            caption="../report/validity.rst",
            category="Studies",
            subcategory="{experiment}",
            labels={"study": "validity of F_a", "content": "figure"},
        ),
        results("figures/{experiment}_validity.pdf"),
    log:
        results("logs/validity/{experiment}.log"),
    benchmark:
        results("benchmarks/validity/{experiment}.tsv")
    wildcard_constraints:
        experiment=one_of([e for e in RUN if jobs.checked(CONFIG, e)]),
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        gpu=GPUS,
    params:
        versions=lambda w: versions("validity", w.experiment),
        settings=lambda w: settings("validity", w.experiment),
        data=lambda w: results(f"{w.experiment}/data"),
    message:
        "check whether F_a holds on {wildcards.experiment}"
    shell:
        "expertaug validity {input.models:q} --data {params.data:q} --output {output:q} --settings {params.settings:q}"
        " --log {log:q}"


rule own_priors_of_experiment:
    input:
        priors=lambda w: [path for _, path in found_priors_of(w.experiment)],
        code=code("own_priors"),
    output:
        results("tables/{experiment}_own_priors.csv"),
        results("tables/{experiment}_own_priors.tex"),
        report(
            results("tables/{experiment}_own_priors.md"),
            caption="../report/own_priors.rst",
            category="Studies",
            subcategory="{experiment}",
            labels={"study": "own p⁺", "content": "table"},
        ),
    log:
        results("logs/own_priors/{experiment}.log"),
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        versions=versions("own_priors"),
        settings=lambda w: json.dumps(
            {
                "experiment": w.experiment,
                "priors": [name for name, _ in found_priors_of(w.experiment)],
                **shown_settings.reading(CONFIG, w.experiment),
            }
        ),
    message:
        "table of the p⁺ of {wildcards.experiment} that found their own ranges"
    shell:
        "expertaug own-priors {input.priors:q} --output {output:q} --settings {params.settings:q} --log {log:q}"


rule grid_of_experiment:
    input:
        models=lambda w: per_seed_group("model.safetensors", w.experiment, jobs.grid(CONFIG, w.experiment)),
        code=code("grid"),
    output:
        results("tables/{experiment}_grid.csv"),
        results("tables/{experiment}_grid.tex"),
        report(
            results("tables/{experiment}_grid.md"),
            caption="../report/grid.rst",
            category="Studies",
            subcategory="{experiment}",
            labels={"study": "grid", "content": "table"},
        ),
        report(
            results("figures/{experiment}_grid.png"),
            caption="../report/grid.rst",
            category="Studies",
            subcategory="{experiment}",
            labels={"study": "grid", "content": "figure"},
        ),
        results("figures/{experiment}_grid.pdf"),
    log:
        results("logs/grid/{experiment}.log"),
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        versions=versions("grid"),
        settings=lambda w: settings("grid", w.experiment),
    message:
        "compare the points of the grid of {wildcards.experiment}"
    shell:
        "expertaug grid {input.models:q} --output {output:q} --settings {params.settings:q} --log {log:q}"


rule dissipation_of_experiment:
    input:
        models=lambda w: per_seed_group("model.safetensors", w.experiment, dissipating_of(w.experiment)),
        sets=expand(results("{{experiment}}/data/{set}.npz"), set=MAIN_SETS),
        code=lambda w: code("dissipation", w.experiment),
    output:
        results("tables/{experiment}_dissipation.csv"),
        results("tables/{experiment}_dissipation.tex"),
        report(
            results("tables/{experiment}_dissipation.md"),
            caption="../report/dissipation.rst",
            category="Studies",
            subcategory="{experiment}",
            labels={"study": "dissipation", "content": "table"},
        ),
        report(
            results("figures/{experiment}_dissipation.png"),
            caption="../report/dissipation.rst",
            category="Studies",
            subcategory="{experiment}",
            labels={"study": "dissipation", "content": "figure"},
        ),
        results("figures/{experiment}_dissipation.pdf"),
    log:
        results("logs/dissipation/{experiment}.log"),
    benchmark:
        results("benchmarks/dissipation/{experiment}.tsv")
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        gpu=GPUS,
    params:
        versions=versions("dissipation"),
        settings=lambda w: settings("dissipation", w.experiment),
        data=lambda w: results(f"{w.experiment}/data"),
    message:
        "compare dissipated power and loss of energy of {wildcards.experiment}"
    shell:
        "expertaug dissipation {input.models:q} --data {params.data:q} --output {output:q} --settings {params.settings:q}"
        " --log {log:q}"


rule compare_experiment:
    input:
        metrics=lambda w: per_seed_group("metrics.csv", w.experiment, jobs.variants(CONFIG, w.experiment)),
        forecasts=lambda w: per_seed_group("forecasts.npz", w.experiment, jobs.variants(CONFIG, w.experiment)),
        published=NUMBERS,
        code=code("compare"),
    output:
        results("tables/{experiment}_published.csv"),
        results("tables/{experiment}_published.md"),
        results("tables/{experiment}_published.tex"),
    log:
        results("logs/compare/{experiment}.log"),
    wildcard_constraints:
        experiment=one_of(COMPARED),
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        versions=versions("compare"),
        settings=lambda w: settings("compare", [w.experiment]),
    message:
        "compare {wildcards.experiment} with the published numbers"
    shell:
        "expertaug compare {input.metrics:q} --forecasts {input.forecasts:q} --output {output:q}"
        " --settings {params.settings:q} --log {log:q}"


if COMPARED:

    # The same over all experiments of the run.
    use rule compare_experiment as compare_all with:
        input:
            metrics=[per_seed_group("metrics.csv", e, jobs.variants(CONFIG, e)) for e in COMPARED],
            forecasts=[per_seed_group("forecasts.npz", e, jobs.variants(CONFIG, e)) for e in COMPARED],
            published=NUMBERS,
            code=code("compare"),
        output:
            results("tables/published.csv"),
            report(
                results("tables/published.md"),
                caption="../report/published.rst",
                category="Tables",
                labels={"content": "published numbers"},
            ),
            results("tables/published.tex"),
        log:
            results("logs/compare.log"),
        params:
            versions=versions("compare"),
            settings=settings("compare", COMPARED),
        message:
            "compare all experiments with the published numbers"


if OVERVIEWS:

    rule plot_overview:
        input:
            metrics=[per_seed_group("metrics.csv", one["name"], jobs.variants(CONFIG, one["name"])) for one in OVERVIEW],
            code=code("overview"),
        output:
            [
                report(
                    results(f"figures/{name}.png"),
                    caption=f"../report/overview_{name}.rst",
                    category="Figures",
                    subcategory="all experiments",
                    labels={"content": OVERVIEW_TITLES[name]},
                )
                for name in OVERVIEWS
            ],
            expand(results("figures/{name}.pdf"), name=OVERVIEWS),
        log:
            results("logs/plot_overview.log"),
        conda:
            "../envs/expertaug.yaml"
        threads: 1
        resources:
            mem_mb=1000,
        params:
            versions=versions("overview"),
            settings=settings("overview", RUN),
            folder=lambda w, output: os.path.dirname(output[0]),
        message:
            "plot all experiments"
        shell:
            "expertaug overview {input.metrics:q} --output {params.folder:q} --settings {params.settings:q} --log {log:q}"


rule write_report:
    input:
        made=read_by_report,
        captions=lambda w: sorted({one["caption"] for one in shown_in_report(read_by_report(w))}),
        template=PAGE,
        code=code("report"),
    output:
        REPORT,
    log:
        results("logs/report.log"),
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        versions=versions("report"),
        settings=lambda w, input: json.dumps(
            {
                "shown": shown_in_report(input.made),
                "rules": rules_before([MADE, EVALUATED], w),
                "files": [os.path.relpath(path) for path in [DEFAULTS, *OVERRIDES]],
                **shown_settings.report(CONFIG),
            },
            sort_keys=True,
        ),
        results=lambda w, output: os.path.dirname(output[0]),
    message:
        "put tables, figures, costs and provenance on a page"
    shell:
        "expertaug report --results {params.results:q} --output {output:q} --settings {params.settings:q} --log {log:q}"


# Targets: `snakemake --cores 2 NAME`.


rule evaluate:
    input:
        and_before(EVALUATED),


rule studies:
    input:
        and_before(
            [
                results(f"{folder}/{experiment}_{name}.{end}")
                for experiment in RUN
                for name in studies_of(experiment)
                for folder, end in (("tables", "md"), ("figures", "png"))
            ]
        ),


rule dissipation:
    input:
        and_before(
            [
                results(f"{folder}/{experiment}_dissipation.{end}")
                for experiment in RUN
                if dissipating_of(experiment)
                for folder, end in (("tables", "md"), ("figures", "png"))
            ]
        ),


rule report:
    input:
        and_before(ALL),


for name in RUN:

    # Everything of one experiment.
    rule:
        name:
            name
        input:
            and_before([results(f"{name}/evaluations.json"), tables_of(name), figures_of(name)]),
