# SPDX-License-Identifier: Apache-2.0
"""Numbers at any byte of a buffer, aligned or not."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def view(data: bytes, code: str) -> NDArray[Any]:
    """View a buffer as one number at every byte.

    Args:
        data: The buffer.
        code: numpy type of the number, with its byte order.

    Returns:
        An array in which element k is the number that begins at byte k; no copy.
    """
    dtype = np.dtype(code)
    count = max(len(data) - dtype.itemsize + 1, 0)
    return np.ndarray((count,), dtype, data, strides=(1,))
