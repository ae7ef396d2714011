# SPDX-License-Identifier: Apache-2.0
"""The array types of the package, and broadcasting: any shapes in, the broadcast shape out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
IndexArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]

# Arrays of this size stay in the cache from one operation to the next.
_BLOCK = 8192


def flatten(*inputs: ArrayLike) -> tuple[tuple[int, ...], list[NDArray[np.float64]]]:
    """Broadcast inputs; return their common shape, and each as a flat float array, a view where it can."""
    arrays = [np.asarray(value, dtype=float) for value in inputs]
    if any(array.shape != arrays[0].shape for array in arrays):
        arrays = list(np.broadcast_arrays(*arrays))
    return arrays[0].shape, [array.reshape(-1) for array in arrays]


def in_blocks(
    function: Callable[..., tuple[NDArray[Any], ...]], *arrays: NDArray[Any]
) -> tuple[NDArray[Any], ...]:
    """Apply a function of flat arrays that works element by element to one part after another.

    A part has up to :data:`_BLOCK` elements.

    Args:
        function: Returns arrays of the size of its own.
        arrays: Flat arrays of one size.

    Returns:
        Its results, each put together to the size of the arrays.
    """
    size = arrays[0].size
    if size <= _BLOCK:
        return function(*arrays)
    results: tuple[NDArray[Any], ...] = ()
    for start in range(0, size, _BLOCK):
        part = slice(start, start + _BLOCK)
        columns = function(*(array[part] for array in arrays))
        results = results or tuple(np.empty(size, column.dtype) for column in columns)
        for result, column in zip(results, columns, strict=True):
            result[part] = column
    return results


def restore(flat: NDArray[Any], shape: tuple[int, ...]) -> Any:
    """Return a flat array in a shape; its one element as a Python number for the shape ``()``."""
    return flat.reshape(shape) if shape else flat[0].item()


def mapped(function: Callable[..., NDArray[np.float64]], *inputs: ArrayLike) -> Any:
    """Apply a function of flat arrays to broadcast inputs; ``nan`` where one is not finite.

    The function works element by element, and is called for parts (:func:`in_blocks`). A result too large
    for a float is ``inf``, without a warning. Scalars give a Python number, else the result has the broadcast
    shape.
    """
    shape, arrays = flatten(*inputs)

    def apply_finite(*parts: NDArray[np.float64]) -> tuple[NDArray[np.float64]]:
        """Return the function's values, ``nan`` where a part is not finite: 1 is put in its place."""
        missing = sum((part - part for part in parts), np.zeros(1))
        if not missing.any():
            return (function(*parts),)
        return (function(*(np.where(missing == 0.0, part, 1.0) for part in parts)) + missing,)

    with np.errstate(all='ignore'):
        return restore(in_blocks(apply_finite, *arrays)[0], shape)
