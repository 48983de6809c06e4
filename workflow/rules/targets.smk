# Targets: `snakemake --cores 2 NAME`. Each asks for every file on its way (src/expertaug/stages/files.py says why), but for
# frame stores: a store is deleted when it has been tracked, unless it was asked for by its target.

VIDEO = ["video.mp4"] if SOURCE == "rendered" else []
MEASURED_FILES = [*VIDEO, "markers.csv", "angles.csv", "angles.json"]


def recorded(*files):
    """Files of every recording; those of an archive are known when it is unpacked."""
    return [lambda wildcards, file=file: of_recordings(file) for file in files] if RECORDED else []


def filmed(*files):
    """The same where there are videos."""
    return recorded(*files) if SOURCE != "markers" else []


def of_experiment(experiment, *files):
    """Files of an experiment, with what its sets are made from."""
    return [recorded(*MEASURED_FILES) if experiment in RECORDED and any(files) else [], *files]


def of_each(files, variants):
    """The same of every experiment: files of its versions, as a function of its name and theirs."""
    return [of_experiment(experiment, files(experiment, variants(experiment))) for experiment in RUN]


def evaluated(experiment):
    scores = FILES.to_scores(experiment, FILES.variants(experiment))
    return of_experiment(experiment, scores, results(f"{experiment}/evaluations.json"))


def split(experiment):
    """The sets of recordings, and what is drawn of them."""
    tables = [results(f"{experiment}/data/{name}") for name in ("chunks.csv", "splits.json")]
    return of_experiment(experiment, sets(experiment, MAIN_SETS), tables, results(f"figures/{experiment}_splits.png"))


def everything(experiment):
    made = [study_files(FILES, experiment, studies(FILES, experiment)), products_of(FILES, experiment)]
    return [split(experiment) if experiment in RECORDED else [], evaluated(experiment), made]


ALL = [
    products_of_all(FILES),
    [everything(e) for e in RUN],
    recorded(*MEASURED_FILES, "page.png"),
    SUMMARY,
    results("report.html"),
]
TARGETS = {
    "render_video": recorded(*VIDEO),
    "extract_frames": filmed(*VIDEO, "frames.b2frame"),
    "track_markers": recorded(*VIDEO, "markers.csv"),
    "measure_angles": recorded(*MEASURED_FILES),
    "plot_recording": recorded(*MEASURED_FILES, "page.png"),
    "overlay": filmed(*MEASURED_FILES, "overlay.mp4"),
    "review": [
        filmed(*MEASURED_FILES, "review.jpg"),
        [results("recordings/review.html")] if filmed("review.jpg") else [],
    ],
    "export": recorded(*MEASURED_FILES, "export/units.csv"),
    "recordings": [recorded(*MEASURED_FILES, "page.png"), SUMMARY],
    "split_chunks": [split(e) for e in RECORDED],
    "cut_measurements": [sets(e, MAIN_SETS) for e in MEASURED],
    "calibrate": [of_experiment(e, sets(e, ["train"]), FILES.calibration(e)) for e in CALIBRATED],
    "simulate": [sets(e, CONFIG.experiments[e].data.set_names) for e in SIMULATED],
    "train": of_each(FILES.to_trainings, FILES.methods),
    "augment": of_each(FILES.to_augmented, FILES.augmented),
    "finetune": of_each(FILES.to_models, FILES.finetuned),
    "flow": of_each(FILES.to_models, FILES.flows),
    "during_training": [of_experiment(e, FILES.to_stages_of_training(e)) for e in RUN],
    "evaluate": [evaluated(e) for e in RUN],
    "studies": [of_experiment(e, study_files(FILES, e, jobs.studies(CONFIG, e))) for e in RUN],
    "dissipation": [of_experiment(e, study_files(FILES, e, ["dissipation"])) for e in RUN],
    "report": ALL,
    **{experiment: everything(experiment) for experiment in RUN},
}
