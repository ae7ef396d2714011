# SPDX-License-Identifier: Apache-2.0
"""Compiles plain scalar functions by numba where it is installed; else they run as they stand.

A rule or an integrator is written once, as plain functions of numbers. What is short runs
interpreted; a long recording or a study runs the same functions compiled. numba is imported only
by :func:`compiled`, because that takes half a second.
"""

from __future__ import annotations

import functools
import zlib
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

# Calls of functions so short cost a third of the time; none divides by zero.
_OPTIONS = {'error_model': 'numpy'}


def has_compiler() -> bool:
    """Whether numba is installed."""
    return find_spec('numba') is not None


@functools.cache
def compiled(entry: str, *modules: ModuleType) -> Callable[..., Any]:
    """Compile a function with all functions of its modules that it may call.

    The plain functions stay as they are: copies of them are compiled. The compiled code is kept
    between processes where numba can write its cache.

    Args:
        entry: Name of the function.
        modules: The module that defines it, and those whose functions it calls; names must differ.

    Returns:
        The compiled function.
    """
    try:
        return _compile(entry, modules, cache=True)
    except RuntimeError:  # numba has no folder that it may write to
        return _compile(entry, modules, cache=False)


def _compile(entry: str, modules: tuple[ModuleType, ...], cache: bool) -> Callable[..., Any]:
    numba = import_module('numba')
    names = {module.__name__ for module in modules}
    space: dict[str, Any] = {}
    for module in modules:
        space |= vars(module)
    digest = _digest(modules)
    for name, function in list(space.items()):
        if isinstance(function, FunctionType) and function.__module__ in names:
            copy = FunctionType(function.__code__, space, name, function.__defaults__)
            copy.__qualname__ = f'{name}_{digest}'
            # Inlining the entry itself would leave nothing to call.
            options = {'error_model': 'numpy'} if name == entry else _OPTIONS
            space[name] = numba.njit(cache=cache, **options)(copy)
    found: Callable[..., Any] = space[entry]
    return found


def _digest(modules: tuple[ModuleType, ...]) -> str:
    """Name of the cached functions: numba does not see when a function they call has changed."""
    sources = [Path(str(module.__file__)).read_bytes() for module in modules]
    return f'{zlib.crc32(repr((_OPTIONS, sources)).encode()):08x}'
