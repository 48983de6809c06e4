"""What a file of arrays holds, as a store shows it: names, types and shapes, without reading the numbers."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np


def described(path: Path) -> dict[str, Any]:
    """``{"schema", "profile"}`` of an npz, in MLflow's words; empty for any other file.

    The schema has its tensors with their names, types and shapes, the profile the number of samples (of ``y``).
    """
    if not zipfile.is_zipfile(path):
        return {}
    tensors = []
    with zipfile.ZipFile(path) as archive:
        for name in archive.namelist():
            with archive.open(name) as stream:
                read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
                shape, _, dtype = read[np.lib.format.read_magic(stream)](stream)
            spec = {"dtype": dtype.name, "shape": list(shape)}
            tensors.append({"name": name.removesuffix(".npy"), "type": "tensor", "tensor-spec": spec})
    samples = next((one["tensor-spec"]["shape"][0] for one in tensors if one["name"] == "y"), None)
    schema = {"mlflow_tensorspec": {"features": tensors, "targets": None}}
    return {"schema": schema} | ({} if samples is None else {"profile": {"num_rows": samples}})
