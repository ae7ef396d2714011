# SPDX-License-Identifier: Apache-2.0
"""Keeps what is computed once for a bearing, its exact folds and cycles, on disk.

A file is never trusted: it begins with a digest of the bearing and of all that follows. Whatever
does not agree with it, or is not a regular file of the usual size, is computed anew.
"""

from __future__ import annotations

import hashlib
import io
import os
import queue
import stat
import tempfile
import threading
from collections.abc import Iterable
from dataclasses import astuple, fields
from pathlib import Path

import numpy as np

from stickslip_monitor.errors import cause
from stickslip_monitor.physics.chebyshev import Pieces, PiecewiseChebyshev2D
from stickslip_monitor.physics.cycle.surface import CycleSurface, surface_of
from stickslip_monitor.physics.friction import Coulomb, Stribeck, Tabulated
from stickslip_monitor.physics.oscillator import Bearing

# Part of every file's name: a file from another version is of no use.
_VERSION = 2
_LARGEST = 64_000_000
_DIGEST = hashlib.sha256().digest_size
_FOLDS = 'folds'


def default_directory() -> Path | None:
    """Where the user's caches are, after the XDG base directory specification.

    Returns:
        ``None`` for a user without a home, as a bare user id in a container.
    """
    base = os.environ.get('XDG_CACHE_HOME', '')
    # The specification has relative paths ignored.
    if Path(base).is_absolute():
        return Path(base) / 'stickslip_monitor'
    try:
        return Path.home() / '.cache' / 'stickslip_monitor'
    except RuntimeError:
        return None


def surface_file(bearing: Bearing) -> str:
    """Name of a bearing's file, made from all that its surface depends on."""
    return f'surface-{hashlib.sha256(_key(bearing)).hexdigest()[:32]}.npz'


def _key(bearing: Bearing) -> bytes:
    return f'{_VERSION} {bearing!r}'.encode()


def prepare_surfaces(bearings: Iterable[Bearing], directory: Path | None = None) -> list[str]:
    """Make the folds and the surface of every bearing ready for use, from disk where they are.

    Args:
        bearings: The bearings.
        directory: Where to keep them; by default the user's cache.

    Returns:
        A sentence for every surface that could not be kept; it is ready all the same.
    """
    folder = default_directory() if directory is None else directory
    complaints = []
    for bearing in bearings:
        surface = surface_of(bearing)
        if not surface.prepared:
            complaints += _prepare(surface, folder)
    return complaints


def _prepare(surface: CycleSurface, folder: Path | None) -> list[str]:
    if not _is_known(surface.bearing):
        surface.prepare()
        return []
    if folder is None:
        surface.prepare()
        return [_complaint('the user has no home directory')]
    path = folder / surface_file(surface.bearing)
    if _read(path, surface):
        return []
    surface.prepare()
    return _keep(path, surface)


def _keep(path: Path, surface: CycleSurface) -> list[str]:
    """Write a surface; why that cannot be, if it cannot."""
    try:
        _write(path, surface)
    except OSError as error:
        return [_complaint(f'{path.parent}: {cause(error)}')]
    return []


class SurfaceBuilder:
    """Builds in a thread what bearings are about to need, so that no callback has to.

    What a surface says does not depend on when it is built.

    Args:
        directory: Where to keep surfaces; by default the user's cache.
    """

    def __init__(self, directory: Path | None = None) -> None:
        self._folder = default_directory() if directory is None else directory
        self._asked: set[Bearing] = set()
        self._waiting: queue.SimpleQueue[tuple[Bearing, range] | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None

    def need(self, bearing: Bearing, load: float) -> None:
        """Have the surface ready for that load [N] and up to twice or half of it."""
        octaves = surface_of(bearing).missing(load)
        if not octaves or bearing in self._asked:
            return
        self._asked.add(bearing)
        self._waiting.put((bearing, octaves))
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name='surfaces', daemon=True)
            self._thread.start()

    def close(self, patience: float = 2.0) -> None:
        """Finish what is being built, unless that takes longer than patience [s]."""
        if self._thread is not None:
            self._waiting.put(None)
            self._thread.join(patience)
            self._thread = None

    def _run(self) -> None:
        while (wanted := self._waiting.get()) is not None:
            bearing, octaves = wanted
            surface = surface_of(bearing)
            surface.prepare()
            surface.extend(octaves)
            if self._folder is not None and _is_known(bearing):
                _keep(self._folder / surface_file(bearing), surface)
            self._asked.discard(bearing)


def _is_known(bearing: Bearing) -> bool:
    """Whether a name stands for a law: of one of the user's own nobody knows for which."""
    return type(bearing.friction) in (Stribeck, Coulomb, Tabulated)


def _complaint(why: str) -> str:
    return f'The surface of exact cycles is built anew at every start: {why}.'


def _read(path: Path, surface: CycleSurface) -> bool:
    """Take the surface from a file; ``False`` where there is none, or not a whole one."""
    try:
        content = _content(path)
    except OSError:
        return False
    if content[:_DIGEST] != _digest(surface.bearing, content[_DIGEST:]):
        return False
    with np.load(io.BytesIO(content[_DIGEST:]), allow_pickle=False) as arrays:
        names = {name.partition('.')[0] for name in arrays.files}
        for name in names - {_FOLDS}:
            columns = (arrays[f'{name}.{field.name}'] for field in fields(PiecewiseChebyshev2D))
            surface.sheets[int(name)] = PiecewiseChebyshev2D(*columns)
        surface.folds.pieces = Pieces(
            *(arrays[f'{_FOLDS}.{field.name}'] for field in fields(Pieces))
        )
    return True


def _content(path: Path) -> bytes:
    """All of a regular file of a size that it can have; nothing of any other."""
    # Opening a pipe would wait for its writer.
    descriptor = os.open(path, os.O_RDONLY | getattr(os, 'O_NONBLOCK', 0))
    with os.fdopen(descriptor, 'rb') as file:
        regular = stat.S_ISREG(os.fstat(descriptor).st_mode)
        content = file.read(_LARGEST + 1) if regular else b''
    return content if len(content) <= _LARGEST else b''


def _digest(bearing: Bearing, payload: bytes) -> bytes:
    return hashlib.sha256(_key(bearing) + payload).digest()


def _named(sheets: dict[int, PiecewiseChebyshev2D]) -> dict[str, PiecewiseChebyshev2D]:
    return {str(octave): sheet for octave, sheet in sheets.items()}


def _write(path: Path, surface: CycleSurface) -> None:
    """Write a file that is whole as soon as it has its name."""
    parts: dict[str, Pieces | PiecewiseChebyshev2D] = {
        _FOLDS: surface.folds.pieces,
        **_named(surface.sheets),
    }
    arrays = {
        f'{name}.{field.name}': column
        for name, part in parts.items()
        for field, column in zip(fields(part), astuple(part), strict=True)
    }
    payload = io.BytesIO()
    np.savez(payload, **arrays)
    content = payload.getvalue()
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor, draft = tempfile.mkstemp(dir=path.parent, suffix='.part')
    try:
        with os.fdopen(descriptor, 'wb') as file:
            file.write(_digest(surface.bearing, content) + content)
        Path(draft).replace(path)
    except BaseException:
        Path(draft).unlink()
        raise
