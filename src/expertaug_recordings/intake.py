"""What becomes of a recording that a stage refuses: the run stops, or goes on without it (recordings.on_bad_recording).

Left out means that the stage writes why into each of its outputs, so that the jobs stay the same: later stages pass
that on, and the table of recordings shows it.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from expertaug.errors import InputError
from expertaug.files import sha256, write_json

START, LONGEST = b'{\n  "refused": "', 10_000  # bytes of a file that says why
logger = logging.getLogger(__name__)


def take(
    task: Callable[[], object],
    source: str | Path,
    outputs: Sequence[str | Path],
    mode: str,
    checksum: str | None = None,
) -> None:
    """Run a stage on one recording.

    Arguments:
        task: the stage; it writes ``outputs``.
        source: the recording: the file that the stage reads.
        mode: ``skip`` writes into ``outputs`` why the recording is left out.
        checksum: SHA-256 that the file must have; None accepts any.

    Raises:
        InputError: the recording is refused and ``mode`` is ``stop``; or what is wrong is not the recording.
    """
    reason = refusal(source)
    if reason is None:
        try:
            _verify(source, checksum)
            task()
            return
        except InputError as error:
            if mode != "skip" or error.where != str(source):
                raise
            reason = str(error)
    elif mode != "skip":
        raise InputError(source, f"left out before ({reason})", "remove it, or set recordings.on_bad_recording to skip")
    logger.warning("left out: %s", reason)
    for output in outputs:
        write_json(output, {"refused": reason})


def refusal(path: str | Path) -> str | None:
    """Why a recording is left out, where an output of a stage says so; None where it holds data or is missing."""
    try:
        with Path(path).open("rb") as stream:
            data = stream.read(LONGEST)
        return str(json.loads(data)["refused"]) if data.startswith(START) else None
    except (OSError, ValueError, KeyError):
        return None


def divide(paths: Iterable[str | Path]) -> tuple[list[Path], dict[str, str]]:
    """Outputs of a stage that hold data, and by recording (the output's folder) why the others do not.

    Raises:
        InputError: none holds data.
    """
    reasons = {Path(path): refusal(path) for path in paths}
    kept = [path for path, reason in reasons.items() if reason is None]
    refused = {path.parent.name: reason for path, reason in reasons.items() if reason is not None}
    if refused and not kept:
        first = next(iter(refused.values()))
        raise InputError("recordings", f"all {len(refused)} are left out; the first: {first}", "mend or replace them")
    return kept, refused


def _verify(path: str | Path, checksum: str | None) -> None:
    if checksum is not None and (digest := sha256(path)) != checksum.lower():
        raise InputError(path, f"SHA-256 is {digest}", f"{checksum} expected: copy the recording again")
