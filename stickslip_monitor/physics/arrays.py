# SPDX-License-Identifier: Apache-2.0
"""Broadcasting for the public functions: any shapes in, the broadcast shape (or a float) out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def flatten(*inputs: ArrayLike) -> tuple[tuple[int, ...], list[NDArray[np.float64]]]:
    """Broadcast inputs and return their common shape and their flat float arrays."""
    arrays = np.broadcast_arrays(*(np.asarray(value, dtype=float) for value in inputs))
    return arrays[0].shape, [array.ravel() for array in arrays]


def restore(flat: NDArray[Any], shape: tuple[int, ...]) -> Any:
    """Give a flat array its shape back; a 0-d array becomes a Python number."""
    return flat.reshape(shape) if shape else flat[0].item()


def mapped(function: Callable[..., NDArray[np.float64]], *inputs: ArrayLike) -> Any:
    """Apply a function of flat arrays to broadcast inputs; ``nan`` where one is not finite.

    A result too large for a float is ``inf``.
    """
    shape, arrays = flatten(*inputs)
    usable = np.isfinite(arrays[0])
    for array in arrays[1:]:
        usable &= np.isfinite(array)
    result = np.full(usable.shape, np.nan)
    with np.errstate(over='ignore'):
        result[usable] = function(*(array[usable] for array in arrays))
    return restore(result, shape)
