# The page of a run: every table and figure that rules mark for reports, under its caption.

SUMMARY = [results("recordings/summary.csv"), results("recordings/summary.md")] if RECORDED else []


def made_of(experiment):
    """Tables and figures of an experiment, tables first."""
    names = {"", *FIGURES, *studies_of(experiment), *["published"] * (experiment in COMPARED)}
    names |= {"splits"} if experiment in RECORDED else set()
    made = [one for one in products.PRODUCTS if one.name in names and not one.of_all]
    files = [file for one in made for file in one.files(experiment)]
    return [
        results(file) for file in sorted([f"tables/{experiment}_long.csv", *files], key=os.path.dirname, reverse=True)
    ]


def made_of_all():
    """Tables and figures over all experiments."""
    names = [*["published"] * bool(COMPARED), *OVERVIEWS]
    return [results(file) for one in products.PRODUCTS if one.of_all and one.name in names for file in one.files("")]


def shown_in_report():
    """Files that rules mark for reports, as the stage report takes them."""
    pages = of_recordings("page.png") if RECORDED else []
    places = {file: k for k, file in enumerate([*made_of_all(), *chain(*map(made_of, RUN)), *SUMMARY, *pages])}
    found = {}
    for path, caption, title in SHOWN:
        kind = next((kind for kind in ("experiment", "recording") if f"{{{kind}}}" in path), None)
        for name in {"experiment": RUN, "recording": recording_names() if RECORDED else [], None: [""]}[kind]:
            named = {kind: name} if kind else {}
            if (file := path.format(**named)) in places:
                found[file] = {
                    "path": os.path.relpath(file, CONFIG.results),
                    "caption": os.path.relpath(HERE / "report" / f"{caption}.rst"),
                    "wildcards": named,
                    "title": title.format(**named),
                }
    return [found[file] for file in sorted(found, key=places.get)]


def read_by_report(wildcards):
    """These tables and figures, and the tables' numbers."""
    files = [results(one["path"]) for one in shown_in_report()]
    numbers = [f"{file.removesuffix('.md')}.csv" for file in files if file.endswith(".md")]
    return [*files, *numbers, *(results(f"tables/{experiment}_long.csv") for experiment in RUN)]


def report_settings(wildcards):
    settings = {
        "shown": shown_in_report(),
        "rules": stages_read(CONFIG),
        "files": [os.path.relpath(path) for path in [DEFAULTS, *OVERRIDES]],
        **shown_settings.report(CONFIG),
    }
    return json.dumps(settings, sort_keys=True)


rule write_report:
    input:
        made=read_by_report,
        captions=lambda w: sorted({one["caption"] for one in shown_in_report()}),
        template=os.path.relpath(PACKAGE / "evaluation" / "report" / "page.html"),
        code=code("report"),
    output:
        results("report.html"),
    log:
        results("logs/report.log"),
    conda:
        "../envs/expertaug.yaml"
    resources:
        mem_mb=1000,
    params:
        versions=versions("report"),
        settings=report_settings,
        results=CONFIG.results,
    message:
        "put tables, figures, costs and provenance on a page"
    shell:
        "expertaug report --results {params.results:q} --output {output:q} --settings {params.settings:q} --log {log:q}"
