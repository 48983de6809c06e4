"""Files of recordings, and what their jobs are told of them."""


def recording_names():
    """Names of the recordings; of an archive they are known only when it is unpacked."""
    return list(RECORDINGS if RECORDINGS is not None else unpacked())


def unpacked():
    """The marker CSVs of the archive by name."""
    from expertaug_recordings.ibm import list_marker_files

    return list_marker_files(checkpoints.unpack_markers.get().output.folder)


def of_recordings(file):
    """A file of every recording."""
    return [results(f"recordings/{name}/{file}") for name in recording_names()]


def video(wildcards):
    """The video of a recording: the user's, or the rendered one."""
    name = wildcards.recording
    return RECORDINGS[name] if SOURCE == "videos" else results(f"recordings/{name}/video.mp4")


def marker_csv(wildcards):
    """The marker CSV of a recording in the user's folder or in the unpacked archive."""
    return str((RECORDINGS if RECORDINGS is not None else unpacked())[wildcards.recording])


def board(wildcards):
    """The pictures of a checkerboard that tell a recording's lens, if any."""
    path = recording_settings.of_recording(CONFIG.recordings, wildcards.recording).angles.rectify.checkerboard
    if path is None:
        return []
    return [str(picture) for picture in list_pictures(Path(path))] if Path(path).is_dir() else [path]


def checksum(wildcards):
    """The option that checks a recording's file, where its checksum is configured."""
    path = CONFIG.recordings.checksums
    if path is None:
        return ""
    file = os.path.basename(video(wildcards) if SOURCE == "videos" else marker_csv(wildcards))
    return f"--sha256 {read_checksums(path, 'recordings.checksums')[file]}"


def to_retry(file):
    """A parameter: whether a recording was left out before and may be so no longer. It redoes the jobs of these, while
    those of sound recordings stay as they are whatever on_bad_recording says."""
    path = results(f"recordings/{{recording}}/{file}")
    return lambda wildcards: ON_BAD_RECORDING == "stop" and refusal(path.format(**wildcards)) is not None


def forecasts_to_draw():
    """Forecasts that overlays draw, by label: those that are there already."""
    overlaid = recording_settings.overlaid(CONFIG)
    if overlaid is None:
        return {}
    experiment, variants = overlaid
    paths = {jobs.label(CONFIG, v): FILES.of_versions(experiment, [v], "forecasts.npz")[0] for v in variants}
    return {label: path for label, path in paths.items() if os.path.exists(path)}
