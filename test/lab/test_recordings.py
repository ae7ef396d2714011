# SPDX-License-Identifier: Apache-2.0
"""The recordings of bags/: as the manifest says, and the monitor's alarms when they are due."""

from __future__ import annotations

import functools
import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from rosbags.rosbag2 import Reader

from benchmarks.voyages import OURS, judge_bag
from benchmarks.warning_quality import Quality, pool_qualities
from stickslip_lab.scenes.scene import load_scene
from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Request
from stickslip_monitor import assess, exact_fold_speed
from stickslip_monitor.monitor.parameters import BearingConfig
from stickslip_monitor.monitor.rule_over_arrays import Scan
from stickslip_monitor.offline.check import RecordingBuffer, check_recording

ROOT = Path(__file__).resolve().parents[2]
BAGS = ROOT / 'bags'
MANIFEST: dict[str, Any] = json.loads((BAGS / 'manifest.json').read_text('utf-8'))
ENTRIES: dict[str, dict[str, Any]] = MANIFEST['bags']
# The scenes of which a closed form knows the alarms: profiles, and noise of the sensors.
PLAIN = [name for name, entry in ENTRIES.items() if entry['events'] is not None]
LADDER = ['normal', 'caution', 'bistable', 'stick_slip', 'amplitude_limit']


def test_manifest_lists_every_scene_and_every_bag() -> None:
    assert set(ENTRIES) == {p.stem for p in (ROOT / 'launch_configs' / 'scenes').glob('*.yaml')}
    assert set(ENTRIES) == {p.name for p in BAGS.iterdir() if p.is_dir()}
    assert sum(p.stat().st_size for p in BAGS.rglob('*') if p.is_file()) < 8_000_000


@pytest.mark.parametrize('name', ENTRIES)
def test_bag_is_as_the_manifest_says(name: str) -> None:
    entry = ENTRIES[name]
    data = (BAGS / entry['file']).read_bytes()
    assert len(data) == entry['bytes']
    assert hashlib.sha256(data).hexdigest() == entry['sha256']
    assert load_scene(ROOT / entry['scene']).seed == entry['seed']
    if name == 'cut_short':
        return
    with Reader(BAGS / name) as reader:
        assert reader.message_count == entry['messages']
        assert reader.start_time == entry['start_ns']
        # rosbags takes the end of a recording to be just after its last message.
        assert reader.duration == entry['duration'] * 1e9 + 1


def test_the_cut_recording_is_whole_up_to_its_cut() -> None:
    """Read it without index and metadata, which rosbags needs; the first of the messages are left."""
    entry = ENTRIES['cut_short']
    assert not (BAGS / 'cut_short' / 'metadata.yaml').exists()
    bag = open_bag(BAGS / 'cut_short')
    (cut,) = bag.cuts
    assert (cut.size, bag.start_ns) == (entry['bytes'], entry['start_ns'])
    assert bag.message_count == entry['messages']
    speed = Request('/shaft/speed', 'data')
    series = bag.read([speed])[speed]
    assert 90.0 < series.value.size / 20.0 < 170.0  # seconds at 20 Hz
    elapsed = (series.log_time_ns - entry['start_ns']) * 1e-9
    np.testing.assert_allclose(elapsed, np.arange(series.value.size) / 20.0, atol=1e-9)
    noise = series.value - np.interp(elapsed, [20.0, 100.0, 150.0], [60.0, 20.0, 20.0])
    assert abs(noise.std() / 0.1 - 1.0) < 5.0 / np.sqrt(2 * noise.size)


def test_lost_inputs_are_reported_and_given_back() -> None:
    """NaN for 12 s at a speed that is safe; ten seconds without the load; a timeout of 5 s."""
    for name, from_s, to_s in (('sensor_values', 200.0, 212.0), ('sensor_clocks', 170.0, 180.0)):
        _, start_ns, scan = scan_single_bearing(name)
        stale = [
            ((event.time_ns - start_ns) * 1e-9, str(event.after) == 'input_stale')
            for event in scan.events
            if 'input_stale' in (str(event.before), str(event.after))
        ]
        (lost, is_stale), (back, _) = stale[:2]
        assert is_stale
        assert lost == pytest.approx(from_s + 5.0, abs=0.4)
        assert back == pytest.approx(to_s, abs=0.4)


@pytest.mark.slow
def test_bags_can_be_made_again_bit_for_bit(tmp_path: Path) -> None:
    """Forbid the vector instructions of this processor: another's last digits may differ."""
    script = ROOT / 'scripts' / 'make_bags.py'
    features = np.show_config(mode='dicts')['SIMD Extensions'].get('found', [])
    environment = os.environ | {
        'PYTHONPATH': str(ROOT),
        'NPY_DISABLE_CPU_FEATURES': ' '.join(features),
        'GLIBC_TUNABLES': 'glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F',
    }
    command = [sys.executable, str(script), '--output', str(tmp_path)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert [line.split(':')[0] for line in done.stdout.splitlines()] == sorted(ENTRIES)
    new_manifest = json.loads((tmp_path / 'manifest.json').read_text('utf-8'))
    same_zstd = MANIFEST['zstd'] == '.'.join(map(str, zstandard.ZSTD_VERSION))
    for name, entry in ENTRIES.items():
        # Another zstd may pack the same messages into other bytes.
        packed = () if same_zstd else ('bytes', 'sha256')
        assert {k: v for k, v in new_manifest['bags'][name].items() if k not in packed} == {
            k: v for k, v in entry.items() if k not in packed
        }
    assert {p.name for p in tmp_path.iterdir()} == {*ENTRIES, 'manifest.json'}


@functools.cache
def scan_recording(name: str) -> list[tuple[BearingConfig, int, Scan]]:
    """Scan a recording; return each bearing, when its monitor starts [ns] and its scan."""
    config = load_scene(ROOT / ENTRIES[name]['scene']).config
    buffer = RecordingBuffer()
    start_ns = check_recording(BAGS / name, config, [buffer]).bag.start_ns
    assert start_ns is not None
    return [(bearing, start_ns, buffer.scan(bearing.name)) for bearing in config.bearings]


def scan_single_bearing(name: str) -> tuple[BearingConfig, int, Scan]:
    """Scan a recording of one bearing."""
    (only,) = scan_recording(name)
    return only


def changed_rungs(old: str, new: str) -> list[tuple[str, bool]]:
    """Return the rungs of the alarm's ladder that a change raises (True) or clears."""
    low, high = sorted((LADDER.index(old), LADDER.index(new)))
    return [(name, new == LADDER[high]) for name in LADDER[low + 1 : high + 1]]


@pytest.mark.parametrize('name', PLAIN)
def test_monitor_gives_every_alarm_when_it_is_due_and_no_other(name: str) -> None:
    """Compare rung by rung: on its way down the alarm may rest where noise holds it."""
    for bearing, start_ns, scan in scan_recording(name):
        due = [
            (*rung, event['earliest'], event['latest'])
            for event in ENTRIES[name]['events']
            if event['bearing'] == bearing.name
            for rung in changed_rungs(event['before'], event['after'])
        ]
        raised = [
            (*rung, (event.time_ns - start_ns) * 1e-9)
            for event in scan.events
            for rung in changed_rungs(str(event.before), str(event.after))
        ]
        for condition in LADDER[1:]:
            expected = [row for row in due if row[0] == condition]
            actual = [row for row in raised if row[0] == condition]
            assert [row[1] for row in actual] == [row[1] for row in expected]
            for (_, _, time), (_, _, earliest, latest) in zip(actual, expected, strict=True):
                assert earliest <= time <= latest


def test_the_pair_differs_in_its_history_only() -> None:
    """Compare the telemetry from 60 s on, which is the same; one lining sticks, the other does not."""
    requests = [Request(topic, 'data') for topic in ('/shaft/speed', '/bearing/aft_stern/load')]
    above, below = (open_bag(BAGS / f'history_{n}').read(requests) for n in ('above', 'below'))
    for request in requests:
        is_late = above[request].log_time_ns >= ENTRIES['history_above']['start_ns'] + 60 * 10**9
        assert is_late.sum() == 301
        assert np.array_equal(above[request].value[is_late], below[request].value[is_late])
    assert ENTRIES['history_above']['episodes'] == []
    (episode,) = ENTRIES['history_below']['episodes']
    assert episode['last_stick'] == 120.0
    last = {name: scan_single_bearing(name)[2].sticking[-1] for name in ('history_above', 'history_below')}
    assert last == {'history_above': False, 'history_below': True}


# Speed at which stick-slip ends on the way up, at 1000 N: the exact fold, 40.718 rpm; it is passed
# at 0.45 rpm/s, 0.52 rpm/s and, in cold_start, by the friction that falls at 44 rpm.
def test_stick_slip_ends_at_the_exact_fold() -> None:
    (episode,) = ENTRIES['coast_down']['episodes']
    assert 15.0 + 0.45 * (episode['last_stick'] - 150.0) == pytest.approx(40.718, abs=0.2)
    (episode,) = ENTRIES['bistable_knock']['episodes']
    assert 36.0 + 24.0 / 50.0 * (episode['last_stick'] - 170.0) == pytest.approx(40.718, abs=0.2)
    # The fold depends on load times friction: a factor f at 1000 N is a load of f times 1000 N.
    (episode,) = ENTRIES['cold_start']['episodes']
    factor = 1.35 - 0.35 * (episode['last_stick'] - 30.0) / 300.0
    reference = load_scene(ROOT / ENTRIES['cold_start']['scene']).config.bearings[0].bearing
    speed = reference.speed.to_surface(44.0, 'rpm')
    assert exact_fold_speed(reference, 1000.0 * factor) == pytest.approx(speed, rel=5e-3)


def test_the_level_is_the_effective_value_of_the_exact_cycle() -> None:
    config = load_scene(ROOT / ENTRIES['measured_knock']['scene']).config.bearings[0]
    assert config.level is not None
    request = Request(config.level.topic, 'data')
    series = open_bag(BAGS / 'measured_knock').read([request])[request]
    elapsed = (series.log_time_ns - ENTRIES['measured_knock']['start_ns']) * 1e-9
    runs = series.value[(elapsed > 140.0) & (elapsed < 170.0)]
    bearing = config.bearing
    amplitude = assess(bearing, bearing.speed.to_surface(36.0, 'rpm'), 1000.0).amplitude_exact
    velocity = amplitude * bearing.natural_frequency / np.sqrt(2.0) * 1e3
    # Sixty values with a scatter of a tenth.
    assert runs.mean() == pytest.approx(velocity, rel=0.04)
    # Before the blows, a floor of 1 mm/s and an engine of 1.5 mm/s at 40.7 rpm, in the sea.
    quiet = series.value[(elapsed > 62.0) & (elapsed < 80.0)]
    assert quiet.mean() == pytest.approx(1.0 + 1.5 * (36.0 / 40.72) ** 2, rel=0.15)
    assert quiet.max() < 5.0


@pytest.mark.parametrize(
    'path',
    sorted((ROOT / 'launch_configs' / 'scenes').glob('*/*.yaml')),
    ids=lambda path: f'{path.parent.stem}-{path.stem}',
)
def test_every_scene_of_the_page_varies_by_seed(path: Path) -> None:
    """Build each with any of its seeds, for any of the ten bearings."""
    sensors = ROOT / 'launch_configs' / 'sensors' / 'poor.yaml'
    scenes = [load_scene(path, seed, sensors) for seed in range(10)]
    assert len({scene.config_path for scene in scenes}) == 10
    points = {str([effect._content for effect in scene.effects]) for scene in scenes}
    assert len(points) == 10
    masses = [scene.config.bearings[0].bearing.mass for scene in scenes]
    assert (min(masses), max(masses)) == (44.0, 12000.0)
    cycles = [s.config.bearings[0].bearing.natural_frequency / (2 * np.pi) for s in scenes]
    assert 8.9 < min(cycles) < max(cycles) < 35.1


# Scored: no episode missed, no alarm without cause, leads as documented.

# Bags with the truth about their lining.
TOLD = [
    name
    for name, entry in ENTRIES.items()
    if 'lining_motion' in {s.name for s in load_scene(ROOT / entry['scene']).effects}
]


@functools.cache
def judge_recording(name: str) -> dict[str, Quality]:
    config = load_scene(ROOT / ENTRIES[name]['scene']).config
    judged = judge_bag(BAGS / name, config)
    return {voyage.bearing: voyage.rules[OURS] for voyage, _ in judged}


# Where the shaft breaks away from rest no warning can come before, and the speed sensor of one is
# stuck while the shaft passes the Hopf speed.
LATE = {'cold_start': 1, 'manoeuvring': 1, 'crash_stop': 1, 'sensor_values': 1}


@pytest.mark.parametrize('name', TOLD)
def test_no_episode_is_missed_and_no_alarm_is_false(name: str) -> None:
    for bearing, quality in judge_recording(name).items():
        episodes = [e for e in ENTRIES[name]['episodes'] if e['bearing'] == bearing]
        assert (quality.episodes, quality.missed, quality.false) == (len(episodes), 0, 0)
        late_warnings = sum(lead < 0.0 for lead in quality.leads)
        assert late_warnings == (LATE.get(name, 0) if episodes else 0)
        # A cycle dies out in 1.2 s, and the alarm is off 5 s later.
        if name in ('history_above', 'voyage', 'coast_down'):
            assert quality.unfounded <= quality.episodes * (3.0 + 1.2 + 5.0 + 1.5)


LIBRARY: dict[str, tuple[int, float | None, float | None, float]] = {
    'bistable_knock': (1, 96.9, None, 49.5),
    'coast_down': (1, 50.0, 2.6, 9.2),
    'cold_start': (1, -0.8, -0.8, 136.2),
    'crash_stop': (3, -0.3, -0.3, 52.1),
    'cut_short': (1, 47.0, 1.9, 1.9),
    'history_above': (0, None, None, 0.0),
    'history_below': (1, 1.2, 1.2, 1.2),
    'load_excursion': (1, 34.5, 3.0, 9.6),
    'manoeuvring': (6, -1.0, -1.0, 153.9),
    'measured_knock': (1, 97.1, -75.1, 87.0),
    'sensor_clocks': (1, 52.6, 1.6, 8.4),
    'sensor_values': (1, -40.6, -40.6, 48.5),
    'slow_steaming_waves': (2, 262.9, None, 4.3),
    'trim_change': (1, 24.3, 1.3, 9.8),
    'two_bearings': (1, 44.5, 1.7, 8.2),
    'voyage': (0, None, None, 0.0),
    'wear': (3, 10.3, None, 47.9),
}
"""Of each recording the episodes, least lead, least lead of the alarm, and for how long it was wrong [s]."""


def test_the_library_keeps_its_figures() -> None:
    assert LIBRARY.keys() == set(TOLD)
    for name, row in LIBRARY.items():
        total = pool_qualities(judge_recording(name).values())
        leads = [round(min(values), 1) if values else None for values in (total.leads, total.alarm_leads)]
        assert (total.episodes, *leads, round(total.unfounded + total.unalarmed, 1)) == row
