"""Tables and figures: what rules make of them, and what the report shows."""

FIGURES = {product.name: product.name.replace("_", " ") for product in products.PLOTTED} | {
    "log_mse": "log-MSE",
    "parameters": "estimated parameters",
    "curves": "trainings",
}
OVERVIEW = report_parameters.overview(CONFIG, RUN)["experiments"]
OVERVIEWS = {name: name.replace("log_mse", "log-MSE").replace("_", " ") for name in overviews(CONFIG)}
SUMMARY = [results("recordings/summary.csv"), results("recordings/summary.md")] if RECORDED else []
SHOWN = []  # path, caption and title of each


def shown(path, caption, title, category, subcategory=None, **labels):
    """An output that reports show under a caption."""
    SHOWN.append((path, caption, title))
    options = {"category": category, "subcategory": subcategory, "labels": labels or {"content": title}}
    return report(path, caption=f"../report/{caption}.rst", **options)


def table(stem, caption, title, category, **labels):
    """The files of a table."""
    files = {end: results(f"tables/{stem}.{end}") for end in products.TABLE_ENDS}
    markdown = shown(files.pop("md"), caption, title, category, **labels)
    return [*files.values(), markdown]


def figure(stem, caption, title, category, **labels):
    """The files of a figure."""
    picture = shown(results(f"figures/{stem}.png"), caption, title, category, **labels)
    return [picture, results(f"figures/{stem}.pdf")]


def figure_of_experiment(name, title):
    return figure(f"{{experiment}}_{name}", name, title, "Figures", subcategory="{experiment}", content=title)


def overview_figure(name, title):
    return figure(name, f"overview_{name}", title, "Figures", subcategory="all experiments", content=title)


def study_outputs(study):
    """Its table and, if it has one, its figure."""
    title = STUDIES[study].title or study.replace("_", " ")
    shown_as = {"caption": study, "title": title, "category": "Studies"}
    labels = {"subcategory": "{experiment}", "study": STUDIES[study].title or study}
    files = table(f"{{experiment}}_{study}", content="table", **shown_as, **labels)
    if study in DRAWN:
        files += figure(f"{{experiment}}_{study}", content="figure", **shown_as, **labels)
    return files


def study_inputs(study):
    return lambda wildcards: STUDIES[study].inputs(FILES, wildcards.experiment, study)


def study_sets(study):
    return lambda wildcards: STUDIES[study].sets(FILES, wildcards.experiment)


def study_params(study):
    stage = STUDIES[study]

    def settings(wildcards):
        return stage.settings_of(CONFIG, *stage.names(wildcards.experiment, study))

    return {"stage": stage.name, "software": software(stage.key()), "settings": settings}


def study_log(study):
    return STUDIES[study].log.replace("{study}", study)


def with_study(study):
    """A wildcard's constraint: experiments that have it."""
    return one_of([experiment for experiment in RUN if study in studies(FILES, experiment)])


def shown_in_report():
    """Files that rules mark for reports, as the stage report takes them."""
    pages = of_recordings("page.png") if RECORDED else []
    places = {
        file: k
        for k, file in enumerate(
            [*products_of_all(FILES), *chain(*(products_of(FILES, e) for e in RUN)), *SUMMARY, *pages]
        )
    }
    by_file = {}
    for path, caption, title in SHOWN:
        kind = next((kind for kind in ("experiment", "recording") if f"{{{kind}}}" in path), None)
        for name in {"experiment": RUN, "recording": recording_names() if RECORDED else [], None: [""]}[kind]:
            named = {kind: name} if kind else {}
            if (file := path.format(**named)) in places:
                by_file[file] = {
                    "path": os.path.relpath(file, CONFIG.results),
                    "caption": os.path.relpath(HERE / "report" / f"{caption}.rst"),
                    "wildcards": named,
                    "title": title.format(**named),
                }
    return [by_file[file] for file in sorted(by_file, key=places.get)]


def read_by_report(wildcards):
    """These tables and figures, and the tables' numbers."""
    files = [results(block["path"]) for block in shown_in_report()]
    numbers = [f"{file.removesuffix('.md')}.csv" for file in files if file.endswith(".md")]
    return [*files, *numbers, *(results(f"tables/{experiment}_long.csv") for experiment in RUN)]


def report_settings(wildcards):
    settings = {
        "shown": shown_in_report(),
        "rules": stages_read(CONFIG),
        "files": [os.path.relpath(path) for path in [DEFAULTS, *OVERRIDES]],
        **report_parameters.report(CONFIG),
    }
    return json.dumps(settings, sort_keys=True)
