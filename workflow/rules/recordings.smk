# From the recordings' source to chunks: video → frames → markers, or marker files → markers; then angles and chunks.


rule render_video_of_recording:
    input:
        code=code("render_video"),
    output:
        video=results("recordings/{recording}/video.mp4"),
        truth=results("recordings/{recording}/truth.csv"),
    log:
        results("logs/render_video/{recording}.log"),
    benchmark:
        results("benchmarks/render_video/{recording}.tsv")
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        versions=versions("render_video"),
        settings=lambda w: settings("render_video"),
        index=lambda w: RECORDINGS[w.recording],
    message:
        "render {wildcards.recording}"
    shell:
        "expertaug render-video --index {params.index} --output {output.video:q} --truth {output.truth:q}"
        " --settings {params.settings:q} --log {log:q}"


rule extract_frames_of_recording:
    input:
        video=lambda w: video_of(w.recording),
        code=code("extract_frames"),
    output:
        temp(results("recordings/{recording}/frames.b2frame")),
    log:
        results("logs/extract_frames/{recording}.log"),
    benchmark:
        results("benchmarks/extract_frames/{recording}.tsv")
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        on_bad_recording=ON_BAD_RECORDING,
    params:
        versions=versions("extract_frames"),
        settings=lambda w: settings("extract_frames", w.recording),
        checksum=lambda w: checksum_of(w.recording),
        retry=lambda w: to_retry(w.recording, "frames.b2frame"),
    message:
        "extract the frames of {wildcards.recording}"
    shell:
        "expertaug extract-frames {input.video:q} --output {output:q} --settings {params.settings:q}"
        " {params.checksum} --on-bad-recording {resources.on_bad_recording} --log {log:q}"


if SOURCE != "markers":

    rule track_markers_of_recording:
        input:
            # Stores are temporary: what they are made from says whether they would be different.
            frames=ancient(results("recordings/{recording}/frames.b2frame")),
            video=lambda w: video_of(w.recording),
            extraction=code("extract_frames"),
            code=code("track_markers"),
        output:
            results("recordings/{recording}/markers.csv"),
        log:
            results("logs/track_markers/{recording}.log"),
        benchmark:
            results("benchmarks/track_markers/{recording}.tsv")
        conda:
            "../envs/expertaug.yaml"
        threads: 1
        resources:
            mem_mb=1000,
            on_bad_recording=ON_BAD_RECORDING,
        params:
            versions=versions("track_markers"),
            settings=lambda w: settings("track_markers", w.recording),
            extraction=lambda w: [settings("extract_frames", w.recording), checksum_of(w.recording)],
            retry=lambda w: to_retry(w.recording, "markers.csv"),
        message:
            "track the markers of {wildcards.recording}"
        shell:
            "expertaug track-markers {input.frames:q} --output {output:q} --settings {params.settings:q}"
            " --on-bad-recording {resources.on_bad_recording} --log {log:q}"

else:

    if RECORDINGS is None:

        checkpoint unpack_markers:
            input:
                archive=CONFIG.recordings.markers.path,
                code=code("unpack_markers"),
            output:
                folder=directory(results("recordings/archive")),
            log:
                results("logs/unpack_markers.log"),
            conda:
                "../envs/expertaug.yaml"
            threads: 1
            resources:
                mem_mb=1000,
            params:
                versions=versions("unpack_markers"),
                settings=lambda w: settings("unpack_markers"),
            message:
                "unpack the marker files of {input.archive}"
            shell:
                "expertaug unpack-markers {input.archive:q} --output {output.folder:q}"
                " --settings {params.settings:q} --log {log:q}"

    rule import_markers_of_recording:
        input:
            csv=lambda w: marker_csv(w.recording),
            code=code("import_markers"),
        output:
            results("recordings/{recording}/markers.csv"),
        log:
            results("logs/import_markers/{recording}.log"),
        conda:
            "../envs/expertaug.yaml"
        threads: 1
        resources:
            mem_mb=1000,
            on_bad_recording=ON_BAD_RECORDING,
        params:
            versions=versions("import_markers"),
            settings=lambda w: settings("import_markers"),
            checksum=lambda w: checksum_of(w.recording),
            retry=lambda w: to_retry(w.recording, "markers.csv"),
        message:
            "import the markers of {wildcards.recording}"
        shell:
            "expertaug import-markers {input.csv:q} --output {output:q} --settings {params.settings:q}"
            " {params.checksum} --on-bad-recording {resources.on_bad_recording} --log {log:q}"


rule measure_angles_of_recording:
    input:
        markers=results("recordings/{recording}/markers.csv"),
        board=lambda w: board_of(w.recording),
        code=code("measure_angles"),
    output:
        angles=results("recordings/{recording}/angles.csv"),
        summary=results("recordings/{recording}/angles.json"),
    log:
        results("logs/measure_angles/{recording}.log"),
    benchmark:
        results("benchmarks/measure_angles/{recording}.tsv")
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        on_bad_recording=ON_BAD_RECORDING,
    params:
        versions=versions("measure_angles"),
        settings=lambda w: settings("measure_angles", w.recording),
        retry=lambda w: to_retry(w.recording, "angles.csv"),
    message:
        "measure the angles of {wildcards.recording}"
    shell:
        "expertaug measure-angles {input.markers:q} --output {output.angles:q} --summary {output.summary:q}"
        " --settings {params.settings:q} --on-bad-recording {resources.on_bad_recording} --log {log:q}"


rule summarise_recordings:
    input:
        summaries=lambda w: of_recordings("angles.json"),
        code=code("summarise_recordings"),
    output:
        csv=results("recordings/summary.csv"),
        markdown=report(
            results("recordings/summary.md"),
            caption="../report/recordings.rst",
            category="Recordings",
            labels={"content": "table of recordings"},
        ),
    log:
        results("logs/summarise_recordings.log"),
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        versions=versions("summarise_recordings"),
    message:
        "summarise the recordings"
    shell:
        "expertaug summarise-recordings {input.summaries:q} --output {output.csv:q} --markdown {output.markdown:q}"
        " --log {log:q}"


rule plot_page_of_recording:
    input:
        markers=results("recordings/{recording}/markers.csv"),
        angles=results("recordings/{recording}/angles.csv"),
        summary=results("recordings/{recording}/angles.json"),
        code=code("plot_recording"),
    output:
        report(
            results("recordings/{recording}/page.png"),
            caption="../report/recording.rst",
            category="Recordings",
            labels={"content": "recording {recording}"},
        ),
    log:
        results("logs/plot_recording/{recording}.log"),
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        versions=versions("plot_recording"),
    message:
        "draw the page of {wildcards.recording}"
    shell:
        "expertaug plot-recording --markers {input.markers:q} --angles {input.angles:q} --summary {input.summary:q}"
        " --output {output:q} --log {log:q}"


rule overlay_video:
    input:
        video=lambda w: video_of(w.recording),
        markers=results("recordings/{recording}/markers.csv"),
        angles=results("recordings/{recording}/angles.csv"),
        summary=results("recordings/{recording}/angles.json"),
        code=code("overlay"),
    output:
        results("recordings/{recording}/overlay.mp4"),
    log:
        results("logs/overlay/{recording}.log"),
    benchmark:
        results("benchmarks/overlay/{recording}.tsv")
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=1500,
    params:
        versions=versions("overlay"),
        settings=lambda w: settings("overlay", w.recording),
        # No inputs: an overlay draws what is there, it does not start a training.
        forecasts=lambda w: [f"{label}={path}" for label, path in forecasts_to_draw().items()],
        drawn=lambda w: [sha256(path) for path in forecasts_to_draw().values()],
    message:
        "draw over the video of {wildcards.recording}"
    shell:
        "expertaug overlay {input.video:q} --markers {input.markers:q} --angles {input.angles:q}"
        " --summary {input.summary:q} --output {output:q} --forecasts {params.forecasts:q}"
        " --settings {params.settings:q} --log {log:q}"


rule review_frames_of_recording:
    input:
        video=lambda w: video_of(w.recording),
        markers=results("recordings/{recording}/markers.csv"),
        angles=results("recordings/{recording}/angles.csv"),
        summary=results("recordings/{recording}/angles.json"),
        code=code("review_recording"),
    output:
        sheet=results("recordings/{recording}/review.jpg"),
        rows=results("recordings/{recording}/review.csv"),
    log:
        results("logs/review_recording/{recording}.log"),
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        versions=versions("review_recording"),
        settings=lambda w: settings("review_recording", w.recording),
    message:
        "look for the worst frames of {wildcards.recording}"
    shell:
        "expertaug review-recording {input.video:q} --markers {input.markers:q} --angles {input.angles:q}"
        " --summary {input.summary:q} --output {output.sheet:q} --rows {output.rows:q}"
        " --settings {params.settings:q} --log {log:q}"


rule review_all_recordings:
    input:
        summaries=lambda w: of_recordings("angles.json"),
        sheets=lambda w: of_recordings("review.jpg"),
        rows=lambda w: of_recordings("review.csv"),
        code=code("review"),
    output:
        results("recordings/review.html"),
    log:
        results("logs/review.log"),
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        versions=versions("review"),
    message:
        "put the worst frames of all recordings on a page"
    shell:
        "expertaug review {input.summaries:q} --output {output:q} --log {log:q}"


rule export_recording:
    input:
        markers=results("recordings/{recording}/markers.csv"),
        angles=results("recordings/{recording}/angles.csv"),
        code=code("export_recording"),
    output:
        expand(results("recordings/{{recording}}/export/{name}"), name=["units.csv", "tracker.csv", "deeplabcut.csv"]),
    log:
        results("logs/export_recording/{recording}.log"),
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        versions=versions("export_recording"),
        folder=lambda w: results(f"recordings/{w.recording}/export"),
    message:
        "export {wildcards.recording}"
    shell:
        "expertaug export-recording --markers {input.markers:q} --angles {input.angles:q} --output {params.folder:q}"
        " --log {log:q}"


rule split_chunks_of_experiment:
    input:
        angles=lambda w: of_recordings("angles.csv"),
        code=code("split_chunks"),
    output:
        expand(results("{{experiment}}/data/{set}.npz"), set=MAIN_SETS),
        chunks=results("{experiment}/data/chunks.csv"),
        splits=results("{experiment}/data/splits.json"),
    log:
        results("logs/split_chunks/{experiment}.log"),
    benchmark:
        results("benchmarks/split_chunks/{experiment}.tsv")
    wildcard_constraints:
        experiment=one_of(RECORDED),
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=3000,
    params:
        versions=versions("split_chunks"),
        settings=lambda w: settings("split_chunks", w.experiment),
        folder=lambda w: results(f"{w.experiment}/data"),
    message:
        "split the recordings into chunks for {wildcards.experiment}"
    shell:
        "expertaug split-chunks {input.angles:q} --output {params.folder:q} --settings {params.settings:q} --log {log:q}"


# Longer chunks of the same frames, which are evaluated alone.
rule cut_horizon_of_experiment:
    input:
        angles=lambda w: of_recordings("angles.csv"),
        code=code("cut_horizon"),
    output:
        results("{experiment}/data/{set}.npz"),
    log:
        results("logs/cut_horizon/{experiment}_{set}.log"),
    wildcard_constraints:
        experiment=one_of(RECORDED),
        set=one_of({name for e in RECORDED for name in jobs.horizons(CONFIG, e)}),
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=3000,
    params:
        versions=versions("cut_horizon"),
        settings=lambda w: settings("cut_horizon", w.experiment, w.set),
    message:
        "cut the chunks of {wildcards.set} for {wildcards.experiment}"
    shell:
        "expertaug cut-horizon {input.angles:q} --output {output:q} --settings {params.settings:q} --log {log:q}"


rule plot_splits_of_experiment:
    input:
        sets=expand(results("{{experiment}}/data/{set}.npz"), set=MAIN_SETS),
        chunks=results("{experiment}/data/chunks.csv"),
        splits=results("{experiment}/data/splits.json"),
        code=code("plot_splits"),
    output:
        report(
            results("figures/{experiment}_splits.png"),
            caption="../report/splits.rst",
            category="Recordings",
            labels={"content": "splits of {experiment}"},
        ),
        results("figures/{experiment}_splits.pdf"),
    log:
        results("logs/plot_splits/{experiment}.log"),
    wildcard_constraints:
        experiment=one_of(RECORDED),
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=2000,
    params:
        versions=versions("plot_splits"),
        folder=lambda w: results(f"{w.experiment}/data"),
    message:
        "draw the splits of {wildcards.experiment}"
    shell:
        "expertaug plot-splits {params.folder:q} --output {output:q} --log {log:q}"


rule calibrate_experiment:
    input:
        train=results("{experiment}/data/train.npz"),
        code=code("calibrate"),
    output:
        results("{experiment}/data/calibration.json"),
    log:
        results("logs/calibrate/{experiment}.log"),
    benchmark:
        results("benchmarks/calibrate/{experiment}.tsv")
    wildcard_constraints:
        experiment=one_of(RECORDED + list(MEASURED)),
    conda:
        "../envs/expertaug.yaml"
    threads: 1
    resources:
        mem_mb=2000,
    params:
        versions=versions("calibrate"),
        settings=lambda w: settings("calibrate", w.experiment),
    message:
        "calibrate the expert of {wildcards.experiment}"
    shell:
        "expertaug calibrate {input.train:q} --output {output:q} --settings {params.settings:q} --log {log:q}"


# Targets: `snakemake --cores 2 NAME`.


rule render_video:
    input:
        of_recordings("video.mp4") if SOURCE == "rendered" and RECORDED else [],


# A frame store is deleted when it has been tracked, unless it was asked for by this target.
rule extract_frames:
    input:
        and_before(of_recordings("frames.b2frame") if SOURCE != "markers" and RECORDED else []),


rule track_markers:
    input:
        and_before(of_all("markers.csv")),


rule measure_angles:
    input:
        and_before(of_all("angles.csv")),


rule plot_recording:
    input:
        and_before(of_all("page.png")),


rule overlay:
    input:
        and_before(of_recordings("overlay.mp4") if SOURCE != "markers" and RECORDED else []),


rule review:
    input:
        and_before([results("recordings/review.html")] if SOURCE != "markers" and RECORDED else []),


rule export:
    input:
        and_before(of_all("export/units.csv")),


rule recordings:
    input:
        and_before([SUMMARY, of_all("page.png")]),


rule split_chunks:
    input:
        and_before(
            [
                expand(results("{experiment}/data/{set}.npz"), experiment=RECORDED, set=MAIN_SETS),
                expand(results("figures/{experiment}_splits.png"), experiment=RECORDED),
            ]
        ),


rule calibrate:
    input:
        and_before([calibration_of(experiment) for experiment in [*RECORDED, *MEASURED]]),
