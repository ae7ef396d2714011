# SPDX-License-Identifier: Apache-2.0
"""Compiles plain scalar functions by numba where it is installed; else they run as they stand.

A rule or an integrator is written once, as plain functions of numbers. What is short runs
interpreted; a long recording or a study runs the same functions compiled, to the same bits. numba is
imported only by :func:`compiled`, because that takes half a second, and never by a live process.
"""

from __future__ import annotations

import functools
import sys
import threading
import zlib
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

# None of the functions divides by zero, and none makes an array: counting who holds those it was
# given takes half of the rule's time. Inlining, as a call passes each array as seven numbers, takes it
# from 155 to 94 ns a sample, exact amplitudes to 4/5 or less, and compiling a tenth longer.
_OPTIONS = {'error_model': 'numpy', '_nrt': False, 'forceinline': True}


_live = threading.Event()


@contextmanager
def interpreted() -> Iterator[None]:
    """Run a block in which no thread of the process loads numba: what answers live cannot wait to compile."""
    before = _live.is_set()
    _live.set()
    try:
        yield
    finally:
        if not before:
            _live.clear()


@functools.cache
def _is_installed() -> bool:
    """Return whether numba can be imported; cached."""
    return find_spec('numba') is not None


def has_compiler() -> bool:
    """Return whether this process may compile: numba is installed, and it is not a live process."""
    return not _live.is_set() and _is_installed()


# The functions that a friction law's own module has in place of those of other modules.
_OF_A_LAW = ('friction_drop', 'friction_slope', 'begin_series', 'extend_series')


@functools.cache
def compiled(entry: str, *modules: ModuleType, law: ModuleType | None = None) -> Callable[..., Any]:
    """Compile a function with all functions of its modules that it may call; cached in the process.

    The plain functions stay as they are: copies of them are compiled. The compiled code is kept
    between processes where numba can write its cache; until it is, a terminal shows a line.

    Args:
        entry: Name of the function.
        modules: The module that defines it, and those whose functions it calls.
        law: The module of a friction law, whose functions it calls in place of those of the same names
            (``_OF_A_LAW``); ``None`` to replace none. numba keeps no code of a function that is handed
            another, but it keeps this.

    Returns:
        The compiled function.

    Raises:
        ImportError: numba is not installed.
    """
    try:
        function = _compile_function(entry, modules, law, cache=True)
    except RuntimeError:  # numba has no folder that it may write to
        function = _compile_function(entry, modules, law, cache=False)
    if sys.stderr.isatty() and not _is_kept(function):
        sys.stderr.write('compiling for long work: seconds, once for this version\n')
    return function


def _is_kept(function: Any) -> bool:
    """Return whether an earlier process has left the compiled code of a function."""
    folder = function.stats.cache_path
    return bool(folder and any(Path(folder).glob(f'*.{function.py_func.__qualname__}-*.nbi')))


def _compile_function(
    entry: str, modules: tuple[ModuleType, ...], law: ModuleType | None, *, cache: bool
) -> Callable[..., Any]:
    """Compile copies of all functions of the modules, bound to each other; return that of ``entry``.

    Arguments are as of :func:`compiled`; ``cache`` says whether numba keeps the code on disk.

    Raises:
        ImportError: numba is not installed.
        RuntimeError: numba has no folder for its cache.
    """
    numba = import_module('numba')
    _register_bisect_right()
    everything = (*modules, law) if law else modules
    digest = _digest_modules(everything)
    compiled_functions: dict[FunctionType, Any] = {}
    spaces = {module.__name__: dict(vars(module)) for module in everything}
    for name, space in spaces.items():
        for function in list(space.values()):
            if isinstance(function, FunctionType) and function.__module__ == name:
                plain_name = function.__name__
                copy = FunctionType(function.__code__, space, plain_name, function.__defaults__)
                copy.__qualname__ = f'{plain_name}_{digest}'
                compiled_functions[function] = numba.njit(cache=cache, **_OPTIONS)(copy)
    _bind_functions(spaces, compiled_functions, law)
    return next(made for plain, made in compiled_functions.items() if plain.__name__ == entry)


def _bind_functions(
    spaces: dict[str, dict[str, Any]], compiled_functions: Mapping[FunctionType, Any], law: ModuleType | None
) -> None:
    """Replace functions in the name spaces of copies, in place, by those that were compiled.

    Args:
        spaces: Name space by module, which the copies look their names up in.
        compiled_functions: Compiled functions by the plain ones; others stay plain.
        law: Its functions take the place of those of :data:`_OF_A_LAW` in every space; ``None`` for none.
    """
    law_functions = {key: vars(law)[key] for key in _OF_A_LAW if hasattr(law, key)}
    for space in spaces.values():
        for key, value in space.items():
            if isinstance(value, FunctionType):
                function = law_functions.get(key, value)
                space[key] = compiled_functions.get(function, function)


@functools.cache
def _register_bisect_right() -> None:
    """Let compiled functions search as plain ones do, which do it fastest by :func:`bisect.bisect_right`."""
    import_module('numba.extending').overload(bisect_right)(_search_of)


def _search_of(values: Any, wanted: Any) -> Callable[[Any, Any], int]:
    """Return the search that numba compiles in place of ``bisect_right`` for values of any type."""

    def search(values: Any, wanted: Any) -> int:
        """Return the first index whose value exceeds ``wanted``, as ``bisect_right``."""
        low, high = 0, len(values)
        while low < high:
            middle = (low + high) // 2
            if wanted < values[middle]:
                high = middle
            else:
                low = middle + 1
        return low

    return search


def _digest_modules(modules: tuple[ModuleType, ...]) -> str:
    """Return a name for cached functions that changes with their modules, which numba does not look at."""
    sources = [Path(str(module.__file__)).read_bytes() for module in modules]
    return f'{zlib.crc32(repr((_OPTIONS, sources)).encode()):08x}'
