# SPDX-License-Identifier: Apache-2.0
"""The inner loops as plain Python, or compiled by numba where it is installed (extra ``sim``)."""

from __future__ import annotations

import functools
import zlib
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.errors import PhysicsError
from stickslip_monitor.physics.motion import kernel, step_series

March = Callable[..., int]
# Calls of functions so short cost a third of the time; none divides by zero.
_OPTIONS = {'error_model': 'numpy', 'inline': 'always'}
_MODULES = {module.__name__: module for module in (step_series, kernel)}


def is_compiled(compiled: bool | None) -> bool:
    """Whether to compile: as asked for, or where numba is installed.

    Raises:
        PhysicsError: It was asked for and numba is not installed.
    """
    installed = find_spec('numba') is not None
    if compiled and not installed:
        raise PhysicsError(
            'compiled = True needs numba, which is not installed: pip install'
            " 'stickslip_monitor[sim]', or leave compiled out"
        )
    return installed if compiled is None else compiled


@functools.cache
def march_function(compiled: bool) -> March:
    """:func:`integrator_kernel.march`, plain or compiled; compiling takes seconds, once."""
    if not compiled:
        return kernel.march
    try:
        return _compile(cache=True)
    except RuntimeError:  # numba has no folder that it may write to
        return _compile(cache=False)


def _compile(cache: bool) -> March:
    """Compile copies of the functions that call each other, so that the plain ones stay."""
    jit = import_module('numba').njit(cache=cache, **_OPTIONS)
    space: dict[str, Any] = {}
    for module in _MODULES.values():
        space |= vars(module)
    digest = _digest()
    for name, function in list(space.items()):
        if isinstance(function, FunctionType) and function.__module__ in _MODULES:
            copy = FunctionType(function.__code__, space, name)
            copy.__qualname__ = f'{name}_{digest}'
            space[name] = jit(copy)
    return space['march']


def _digest() -> str:
    """Names the cached functions: numba does not see when a function they call has changed."""
    sources = [Path(str(module.__file__)).read_bytes() for module in _MODULES.values()]
    return f'{zlib.crc32(repr((_OPTIONS, sources)).encode()):08x}'


def vector(values: Any, compiled: bool, kind: type = float) -> Any:
    """What the inner loops take for an array: an array if compiled, else lists, which are fast."""
    array: NDArray[Any] = np.ascontiguousarray(values, dtype=kind)
    return array if compiled else array.tolist()
