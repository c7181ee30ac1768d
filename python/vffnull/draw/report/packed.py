"""Arrays as text for the page's script."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray


def packed(values: NDArray[Any]) -> str:
    """Base64 of little-endian float32, finer than any screen; NaN stands for what cannot be drawn."""
    drawable = np.where(np.abs(values) <= np.finfo("<f4").max, values, np.nan)
    return base64.b64encode(np.ascontiguousarray(drawable, dtype="<f4").tobytes()).decode()
