# SPDX-License-Identifier: Apache-2.0
"""Surfaces on disk: built once, never trusted when damaged, never in the way."""

from __future__ import annotations

import os

import numpy as np
import pytest

from stickslip_monitor import surface_store
from stickslip_monitor.physics.cycle.surface import CycleSurface
from stickslip_monitor.physics.friction import Coulomb, Stribeck
from stickslip_monitor.physics.oscillator import Bearing
from stickslip_monitor.surface_store import prepare_surfaces, surface_file

BEARING = Bearing(50.0, 400.0, 2.0e6, Stribeck(0.30, 0.10, 10.0), 0.100)
SPEED, LOAD, FOLD = np.array([0.1]), np.array([1000.0]), np.array([0.2132256])


@pytest.fixture
def built(monkeypatch) -> list[Bearing]:
    """Every call starts with surfaces of its own, as a new process does; lists what was built."""
    made: list[Bearing] = []
    build = CycleSurface._build

    def counting(self, number):
        made.append(self.bearing)
        return build(self, number)

    monkeypatch.setattr(CycleSurface, '_build', counting)
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


@pytest.mark.parametrize('keep', [0, 10, 3000])
def test_a_cut_file_is_built_anew_and_mended(tmp_path, built, surfaces, keep):
    prepare_surfaces([BEARING], tmp_path)
    path = tmp_path / surface_file(BEARING)
    whole = path.read_bytes()
    path.write_bytes(whole[:keep])
    surfaces.clear()
    assert prepare_surfaces([BEARING], tmp_path) == []
    assert len(built) == 2
    assert path.stat().st_size == len(whole)


def test_a_changed_byte_is_noticed(tmp_path, built, surfaces):
    prepare_surfaces([BEARING], tmp_path)
    path = tmp_path / surface_file(BEARING)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0x55
    path.write_bytes(content)
    surfaces.clear()
    prepare_surfaces([BEARING], tmp_path)
    assert len(built) == 2


def test_a_place_that_cannot_be_written_is_told_and_stops_nothing(tmp_path, surfaces):
    place = tmp_path / 'file'
    place.write_text('no folder')
    (complaint,) = prepare_surfaces([BEARING], place)
    assert 'built anew at every start' in complaint
    assert str(place) in complaint
    assert surfaces[BEARING].prepared


def test_a_full_disk_leaves_no_half_written_file(tmp_path, surfaces, monkeypatch):
    def full(file, **arrays):
        file.write(b'PK')
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(surface_store.np, 'savez', full)
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


def test_a_bearing_without_a_surface_needs_no_file(tmp_path, surfaces):
    rising = Bearing(50.0, 400.0, 2.0e6, Stribeck(0.1, 0.3, 10.0), 0.1)
    assert prepare_surfaces([rising], tmp_path) == []
    assert list(tmp_path.iterdir()) == []
