"""Where light is in an image."""

from __future__ import annotations

import numpy as np


def centroid(image, about, radius):
    y, x = np.indices(image.shape)
    inside = np.clip(radius - np.hypot(x - about[0], y - about[1]), 0, 1) * image
    return np.array([(inside * x).sum(), (inside * y).sum()]) / inside.sum()
