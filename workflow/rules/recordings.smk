# From the recordings' source to chunks: video → frames → markers, or marker files → markers; then angles.


rule render_video_of_recording:
    output:
        video=results("recordings/{recording}/video.mp4"),
        truth=results("recordings/{recording}/truth.csv"),
    log:
        results("logs/render_video/{recording}.log"),
    resources:
        mem_mb=1000,
    params:
        **stage_params("render_video"),
        index=lambda w: RECORDINGS[w.recording],
    message:
        "render {wildcards.recording}"
    shell:
        command("render_video", "params.index output.video output.truth")


rule extract_frames_of_recording:
    input:
        video=video,
    output:
        temp(results("recordings/{recording}/frames.b2frame")),
    log:
        results("logs/extract_frames/{recording}.log"),
    resources:
        mem_mb=1000,
        on_bad_recording=ON_BAD_RECORDING,
    params:
        **stage_params("extract_frames", "recording"),
        sha256=checksum,
        retry=to_retry("frames.b2frame"),
    message:
        "extract the frames of {wildcards.recording}"
    shell:
        command("extract_frames", "input.video output resources.on_bad_recording params.sha256")


if SOURCE != "markers":

    rule track_markers_of_recording:
        input:
            # Stores are temporary: what they are made from says whether they would be different.
            frames=ancient(results("recordings/{recording}/frames.b2frame")),
            video=video,
        output:
            results("recordings/{recording}/markers.csv"),
        log:
            results("logs/track_markers/{recording}.log"),
        resources:
            mem_mb=1000,
            on_bad_recording=ON_BAD_RECORDING,
        params:
            **stage_params("track_markers", "recording"),
            extraction=lambda w: [
                *software("extract_frames")(w),
                settings("extract_frames", "recording")(w),
                checksum(w),
            ],
            retry=to_retry("markers.csv"),
        message:
            "track the markers of {wildcards.recording}"
        shell:
            command("track_markers", "input.frames output resources.on_bad_recording")

else:

    if RECORDINGS is None:

        checkpoint unpack_markers:
            input:
                archive=CONFIG.recordings.markers.path,
            output:
                folder=directory(results("recordings/archive")),
            log:
                results("logs/unpack_markers.log"),
            resources:
                mem_mb=1000,
            params:
                **stage_params("unpack_markers"),
            message:
                "unpack the marker files of {input.archive}"
            shell:
                command("unpack_markers", "input.archive output.folder")

    rule import_markers_of_recording:
        input:
            csv=marker_csv,
        output:
            results("recordings/{recording}/markers.csv"),
        log:
            results("logs/import_markers/{recording}.log"),
        resources:
            mem_mb=1000,
            on_bad_recording=ON_BAD_RECORDING,
        params:
            **stage_params("import_markers"),
            sha256=checksum,
            retry=to_retry("markers.csv"),
        message:
            "import the markers of {wildcards.recording}"
        shell:
            command("import_markers", "input.csv output resources.on_bad_recording params.sha256")


rule measure_angles_of_recording:
    input:
        markers=results("recordings/{recording}/markers.csv"),
        board=board,
    output:
        angles=results("recordings/{recording}/angles.csv"),
        summary=results("recordings/{recording}/angles.json"),
    log:
        results("logs/measure_angles/{recording}.log"),
    resources:
        mem_mb=1500,
        on_bad_recording=ON_BAD_RECORDING,
    params:
        **stage_params("measure_angles", "recording"),
        retry=to_retry("angles.csv"),
    message:
        "measure the angles of {wildcards.recording}"
    shell:
        command("measure_angles", "input.markers output.angles output.summary resources.on_bad_recording")


rule summarise_recordings:
    input:
        summaries=lambda w: of_recordings("angles.json"),
    output:
        csv=results("recordings/summary.csv"),
        markdown=shown(results("recordings/summary.md"), "recordings", "table of recordings", "Recordings"),
    log:
        results("logs/summarise_recordings.log"),
    resources:
        mem_mb=1000,
    params:
        software=software("summarise_recordings"),
    message:
        "summarise the recordings"
    shell:
        command("summarise_recordings", "input.summaries output.csv output.markdown")


rule plot_page_of_recording:
    input:
        markers=results("recordings/{recording}/markers.csv"),
        angles=results("recordings/{recording}/angles.csv"),
        summary=results("recordings/{recording}/angles.json"),
    output:
        shown(results("recordings/{recording}/page.png"), "recording", "recording {recording}", "Recordings"),
    log:
        results("logs/plot_recording/{recording}.log"),
    resources:
        mem_mb=1000,
    params:
        software=software("plot_recording"),
    message:
        "draw the page of {wildcards.recording}"
    shell:
        command("plot_recording", "input.markers input.angles input.summary output")


rule overlay_video:
    input:
        video=video,
        markers=results("recordings/{recording}/markers.csv"),
        angles=results("recordings/{recording}/angles.csv"),
        summary=results("recordings/{recording}/angles.json"),
    output:
        results("recordings/{recording}/overlay.mp4"),
    log:
        results("logs/overlay/{recording}.log"),
    resources:
        mem_mb=1500,
    params:
        **stage_params("overlay", "recording"),
        # No inputs: an overlay draws what is there, it does not start a training.
        forecasts=lambda w: [f"{label}={path}" for label, path in forecasts_to_draw().items()],
        drawn=lambda w: [sha256(path) for path in forecasts_to_draw().values()],
    message:
        "draw over the video of {wildcards.recording}"
    shell:
        command("overlay", "input.video input.markers input.angles input.summary output params.forecasts")


rule review_frames_of_recording:
    input:
        video=video,
        markers=results("recordings/{recording}/markers.csv"),
        angles=results("recordings/{recording}/angles.csv"),
        summary=results("recordings/{recording}/angles.json"),
    output:
        sheet=results("recordings/{recording}/review.jpg"),
        rows=results("recordings/{recording}/review.csv"),
    log:
        results("logs/draw_worst_frames/{recording}.log"),
    resources:
        mem_mb=1000,
    params:
        **stage_params("draw_worst_frames", "recording"),
    message:
        "look for the worst frames of {wildcards.recording}"
    shell:
        command("draw_worst_frames", "input.video input.markers input.angles input.summary output.sheet output.rows")


rule review_all_recordings:
    input:
        summaries=lambda w: of_recordings("angles.json"),
        sheets=lambda w: of_recordings("review.jpg"),
        rows=lambda w: of_recordings("review.csv"),
    output:
        results("recordings/review.html"),
    log:
        results("logs/review.log"),
    resources:
        mem_mb=1000,
    params:
        software=software("review"),
    message:
        "put the worst frames of all recordings on a page"
    shell:
        command("review", "input.summaries output")


rule export_recording:
    input:
        markers=results("recordings/{recording}/markers.csv"),
        angles=results("recordings/{recording}/angles.csv"),
    output:
        expand(results("recordings/{{recording}}/export/{name}"), name=["units.csv", "tracker.csv", "deeplabcut.csv"]),
    log:
        results("logs/export_recording/{recording}.log"),
    resources:
        mem_mb=1000,
    params:
        software=software("export_recording"),
        folder=folder("recordings/{recording}/export"),
    message:
        "export {wildcards.recording}"
    shell:
        command("export_recording", "input.markers input.angles params.folder")
