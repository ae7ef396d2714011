# SPDX-License-Identifier: Apache-2.0
"""Keeps the surfaces of exact cycles on disk, so that a bearing's is built once."""

from __future__ import annotations

import hashlib
import os
import tempfile
import zipfile
from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_monitor.physics.chebyshev import PiecewiseChebyshev1D, PiecewiseChebyshev2D
from stickslip_monitor.physics.cycle.surface import VERSION, CycleSurface, Sheet, surface_of
from stickslip_monitor.physics.oscillator import Bearing

_PARTS: dict[str, type] = {'fold': PiecewiseChebyshev1D, 'size': PiecewiseChebyshev2D}


def default_directory() -> Path:
    """Where the user's caches are, after the XDG base directory specification."""
    base = os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache'
    return Path(base) / 'stickslip_monitor'


def surface_file(bearing: Bearing) -> str:
    """Name of a bearing's file, made from all that its surface depends on."""
    content = f'{VERSION} {bearing!r}'
    return f'surface-{hashlib.sha256(content.encode()).hexdigest()[:32]}.npz'


def prepare_surfaces(bearings: Iterable[Bearing], directory: Path | None = None) -> list[str]:
    """Make the surface of every bearing ready for use, from disk where it is there.

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
            complaints += _prepare(surface, folder / surface_file(bearing))
    return complaints


def _prepare(surface: CycleSurface, path: Path) -> list[str]:
    sheet = _read(path)
    if sheet is not None:
        surface.sheets[0] = sheet
        return []
    surface.prepare()
    try:
        _write(path, surface.sheets[0])
    except OSError as error:
        return [f'The surface of exact cycles is built anew at every start: {error}.']
    return []


def _read(path: Path) -> Sheet | None:
    """The sheet of a file; ``None`` where there is none, or a damaged one."""
    try:
        with np.load(path, allow_pickle=False) as arrays:
            parts: dict[str, Any] = {
                name: kind(*(arrays[f'{name}.{field.name}'] for field in fields(kind)))
                for name, kind in _PARTS.items()
            }
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    return Sheet(**parts)


def _write(path: Path, sheet: Sheet) -> None:
    """Write a file that is whole as soon as it has its name."""
    arrays = {
        f'{name}.{field.name}': getattr(getattr(sheet, name), field.name)
        for name, kind in _PARTS.items()
        for field in fields(kind)
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor, draft = tempfile.mkstemp(dir=path.parent, suffix='.part')
    try:
        with os.fdopen(descriptor, 'wb') as file:
            np.savez(file, **arrays)
        Path(draft).replace(path)
    except BaseException:
        Path(draft).unlink()
        raise
