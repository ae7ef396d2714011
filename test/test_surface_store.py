# SPDX-License-Identifier: Apache-2.0
"""Surfaces on disk: built once, never trusted when damaged, never in the way."""

from __future__ import annotations

import os
import random
from collections.abc import Iterator

import numpy as np
import pytest

from stickslip_monitor import surface_store
from stickslip_monitor.physics.cycle.surface import CycleSurface
from stickslip_monitor.physics.friction import Coulomb, Stribeck
from stickslip_monitor.physics.oscillator import Bearing
from stickslip_monitor.surface_store import SurfaceBuilder, prepare_surfaces, surface_file

BEARING = Bearing(50.0, 400.0, 2.0e6, Stribeck(0.30, 0.10, 10.0), 0.100)
SPEED, LOAD, FOLD = np.array([0.1]), np.array([1000.0]), np.array([0.2132256])


@pytest.fixture
def built(monkeypatch) -> list[Bearing]:
    """Lists the bearings whose surfaces were built."""
    made: list[Bearing] = []
    prepare = CycleSurface.prepare

    def counting(self):
        made.append(self.bearing)
        prepare(self)

    monkeypatch.setattr(CycleSurface, 'prepare', counting)
    return made


@pytest.fixture
def surfaces(monkeypatch) -> dict[Bearing, CycleSurface]:
    """The surfaces of the process; clearing it is starting anew."""
    table: dict[Bearing, CycleSurface] = {}

    def surface_of(bearing):
        return table.setdefault(bearing, CycleSurface(bearing))

    monkeypatch.setattr(surface_store, 'surface_of', surface_of)
    return table


def test_a_second_start_reads_what_the_first_one_built(tmp_path, built, surfaces):
    assert prepare_surfaces([BEARING], tmp_path) == []
    first, known = surfaces[BEARING].lookup(SPEED, LOAD, FOLD)
    assert known.all()
    surfaces.clear()
    assert prepare_surfaces([BEARING], tmp_path) == []
    second, known = surfaces[BEARING].lookup(SPEED, LOAD, FOLD)
    assert built == [BEARING]
    assert known.all()
    np.testing.assert_array_equal(first, second)
    assert [path.name for path in tmp_path.iterdir()] == [surface_file(BEARING)]


def test_what_a_load_will_need_is_built_beside_and_kept(tmp_path, surfaces):
    surface = surfaces[BEARING] = CycleSurface(BEARING)
    builder = SurfaceBuilder(tmp_path)
    # c/(Delta beta) = 200 N is the least load with a cycle: 9 kN are in the sixth octave above.
    assert list(surface.missing(9000.0)) == [4, 5, 6]
    builder.need(BEARING, 9000.0)
    builder.close(60.0)
    assert not surface.missing(9000.0)
    surfaces.clear()
    assert prepare_surfaces([BEARING], tmp_path) == []
    assert not surfaces[BEARING].missing(9000.0)
    for load in (0.0, -5.0, 100.0, np.inf, np.nan):
        assert not surface.missing(load)


def test_every_property_that_counts_has_a_file_of_its_own():
    others = [
        Bearing(51.0, 400.0, 2.0e6, Stribeck(0.30, 0.10, 10.0), 0.100),
        Bearing(50.0, 401.0, 2.0e6, Stribeck(0.30, 0.10, 10.0), 0.100),
        Bearing(50.0, 400.0, 2.1e6, Stribeck(0.30, 0.10, 10.0), 0.100),
        Bearing(50.0, 400.0, 2.0e6, Stribeck(0.31, 0.10, 10.0), 0.100),
        Bearing(50.0, 400.0, 2.0e6, Stribeck(0.30, 0.11, 10.0), 0.100),
        Bearing(50.0, 400.0, 2.0e6, Stribeck(0.30, 0.10, 10.1), 0.100),
        Bearing(50.0, 400.0, 2.0e6, Stribeck(0.30, 0.10, 10.0, 1e-3), 0.100),
        Bearing(50.0, 400.0, 2.0e6, Coulomb(0.30, 0.10), 0.100),
    ]
    assert len({surface_file(bearing) for bearing in (BEARING, *others)}) == 9


def _mutants(whole: bytes, count: int) -> Iterator[bytes]:
    """Cuts, changed bytes, removed and doubled stretches of a file; none of them itself."""
    rng = random.Random(7)
    yield from (b'', whole[:10], whole[:3000], whole + b'x', bytes(len(whole)))
    for number in range(count):
        start, length = rng.randrange(len(whole)), rng.randrange(1, 200)
        stop = min(start + length, len(whole))
        changed = bytes(byte ^ rng.randrange(1, 256) for byte in whole[start:stop])
        middle = (changed[:1], changed, b'', whole[start:stop] * 2)[number % 4]
        rest = whole[start + 1 :] if number % 4 == 0 else whole[stop:]
        yield whole[:start] + middle + rest


def test_no_damaged_file_is_believed(tmp_path, surfaces):
    prepare_surfaces([BEARING], tmp_path)
    path = tmp_path / surface_file(BEARING)
    whole = path.read_bytes()
    fresh = CycleSurface(BEARING)
    for mutant in _mutants(whole, 3000):
        path.write_bytes(mutant)
        assert not surface_store._read(path, fresh)
    assert not fresh.sheets


@pytest.mark.parametrize('damage', ['cut', 'foreign', 'plain arrays', 'pipe', 'folder', 'huge'])
def test_what_is_not_a_surface_of_the_bearing_is_built_anew(
    tmp_path, built, surfaces, damage, monkeypatch
):
    prepare_surfaces([BEARING], tmp_path)
    path = tmp_path / surface_file(BEARING)
    whole = path.read_bytes()
    stiffer = Bearing(50.0, 400.0, 2.1e6, Stribeck(0.30, 0.10, 10.0), 0.100)
    if damage == 'cut':
        path.write_bytes(whole[:3000])
    elif damage == 'foreign':
        prepare_surfaces([stiffer], tmp_path)
        (tmp_path / surface_file(stiffer)).replace(path)
    elif damage == 'plain arrays':
        np.savez(path, **{'folds.cell': np.zeros(1280)})
    elif damage == 'huge':
        monkeypatch.setattr(surface_store, '_LARGEST', len(whole) - 1)
    else:
        path.unlink()
        os.mkfifo(path) if damage == 'pipe' else path.mkdir()
    surfaces.clear()
    built.clear()
    complaints = prepare_surfaces([BEARING], tmp_path)
    assert built == [BEARING]
    assert surfaces[BEARING].prepared
    assert bool(complaints) is (damage == 'folder')
    assert damage == 'folder' or path.read_bytes() == whole


def test_a_user_without_a_home_gets_a_sentence_and_a_surface(monkeypatch, surfaces):
    monkeypatch.delenv('XDG_CACHE_HOME', raising=False)
    monkeypatch.delenv('HOME', raising=False)
    monkeypatch.setattr('os.path.expanduser', lambda path: path)
    (complaint,) = prepare_surfaces([BEARING])
    assert complaint.endswith('at every start: the user has no home directory.')
    assert surfaces[BEARING].prepared


def test_a_place_that_cannot_be_written_is_told_and_stops_nothing(tmp_path, surfaces):
    place = tmp_path / 'file'
    place.write_text('no folder')
    (complaint,) = prepare_surfaces([BEARING], place)
    assert 'built anew at every start' in complaint
    assert str(place) in complaint
    assert surfaces[BEARING].prepared


def test_a_full_disk_leaves_no_half_written_file(tmp_path, surfaces, monkeypatch):
    def full(self, target):
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr('pathlib.Path.replace', full)
    (complaint,) = prepare_surfaces([BEARING], tmp_path)
    assert 'No space left' in complaint
    assert list(tmp_path.iterdir()) == []


def test_the_default_place_follows_the_base_directory_specification(monkeypatch, tmp_path):
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    assert surface_store.default_directory() == tmp_path / 'stickslip_monitor'
    monkeypatch.delenv('XDG_CACHE_HOME')
    monkeypatch.setenv('HOME', str(tmp_path / 'home'))
    place = tmp_path / 'home' / '.cache' / 'stickslip_monitor'
    assert surface_store.default_directory() == place
    monkeypatch.setenv('XDG_CACHE_HOME', 'relative')
    assert surface_store.default_directory() == place


def test_a_bearing_without_a_surface_needs_no_file(tmp_path, surfaces):
    rising = Bearing(50.0, 400.0, 2.0e6, Stribeck(0.1, 0.3, 10.0), 0.1)
    assert prepare_surfaces([rising], tmp_path) == []
    assert list(tmp_path.iterdir()) == []
