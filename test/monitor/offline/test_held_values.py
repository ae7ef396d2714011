# SPDX-License-Identifier: Apache-2.0
"""Sources that store changes only: values stand, offline as live, and the pattern is named."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sending import SECOND, T0, Ship, configured, stream_of
from shared import ROOT

from stickslip_monitor import MonitorConfig, Stream
from stickslip_monitor.cli import main
from stickslip_monitor.monitor.bearing_monitor import repeat_step
from stickslip_monitor.monitor.rule_over_arrays import BearingScan
from stickslip_monitor.monitor.sample_types import Input
from stickslip_monitor.offline.held_values import HeldValues

# Of a shaft that does ten minutes at each speed [s, rpm]; a historian stores three values.
COURSE = ((0.0, 136.0), (600.0, 20.0), (1200.0, 136.0))
END = 1800.0


def config_with_hold(**changes: Any) -> MonitorConfig:
    return configured(speed__hold=3600.0, load__hold=3600.0, **changes)


def changes_only() -> Stream:
    rows = [(0.0, Input.LOAD, 0.0, 1000.0), *((t, Input.SPEED, t, rpm) for t, rpm in COURSE)]
    return stream_of(rows, T0)  # type: ignore[arg-type]


def every_second() -> Stream:
    """Return the same course from a sensor."""
    times = np.arange(0.0, END)
    rpm = np.array([rpm for _, rpm in COURSE])[np.searchsorted([t for t, _ in COURSE], times, 'right') - 1]
    stamp = np.repeat(np.rint(times * SECOND).astype(np.int64) + T0, 2)
    value = np.stack([np.full(times.size, 1000.0), rpm], axis=1).ravel()
    return Stream(stamp, np.tile([Input.LOAD, Input.SPEED], times.size), value)


def scan_events(config: MonitorConfig, stream: Stream) -> list[tuple[float, str]]:
    scan = BearingScan(config.bearings[0], T0).finish(stream, T0 + round(END * SECOND))
    return [((event.time_ns - T0) / SECOND, str(event.after)) for event in scan.events]


def fill_stream(config: MonitorConfig) -> Stream:
    return HeldValues(config.bearings[0]).fill(changes_only(), T0 + round(END * SECOND))[0]


def test_three_values_that_stand_are_the_voyage_of_a_sensor() -> None:
    # Each delay runs on by an eighth of it at most: each of the sensor's events comes, and no other.
    expected, actual = (
        scan_events(configured(), every_second()),
        scan_events(config_with_hold(), fill_stream(config_with_hold())),
    )
    assert [name for _, name in actual] == [name for _, name in expected]
    assert {'stick_slip', 'normal'} <= {name for _, name in actual}
    for (at, _), (delayed_at, _) in zip(expected, actual, strict=True):
        since = max(t for t, _ in COURSE if t <= at)
        assert at - 1.0 <= delayed_at <= since + 1.125 * (at - since) + 2.0
    assert 'input_stale' in {name for _, name in scan_events(configured(), changes_only())}


def test_live_is_offline() -> None:
    ship = Ship(config_with_hold())
    rows = [*COURSE, (END, 0.0)]
    for place, value in ((Input.LOAD, 1000.0), (Input.SPEED, COURSE[0][1])):
        ship.take('aft', place, value)
    for at, rpm in rows[1:]:
        while ship.now.time_ns < T0 + round(at * SECOND):
            ship.steady_ns += SECOND
            ship.tick()
        if at < END:
            ship.take('aft', Input.SPEED, rpm)
    live = [((event.time_ns - T0) / SECOND, str(event.after)) for event in ship.events]
    offline = scan_events(config_with_hold(), fill_stream(config_with_hold()))
    assert [name for _, name in live] == [name for _, name in offline]
    assert [at for at, _ in live] == pytest.approx([at for at, _ in offline], abs=3.0)
    counts = ship.look()['inputs']['speed']['counts']
    assert (counts['accepted'], counts['repeated']) == (3, 0)


def test_a_value_stands_as_long_as_hold_says() -> None:
    ship = Ship(configured(speed__hold=900.0, load__hold=3600.0))
    for place, value in ((Input.LOAD, 1000.0), (Input.SPEED, 136.0)):
        ship.take('aft', place, value)
    for _ in range(1000):
        ship.steady_ns += SECOND
        ship.tick()
    lost = [event for event in ship.events if str(event.after) == 'input_stale']
    assert [(event.time_ns - T0) / SECOND for event in lost] == pytest.approx([900.0])
    assert 'Input speed lost' in lost[0].text


def test_an_invalid_number_ends_the_repeats_live_and_offline() -> None:
    """'unavailable' of home automation: the value before it stands, but nothing new is made of it."""
    rows = [(0.0, Input.LOAD, 0.0, 1000.0), (0.0, Input.SPEED, 0.0, 136.0), (60.0, Input.SPEED, 60.0, np.nan)]
    stream, repeats = HeldValues(config_with_hold().bearings[0]).fill(stream_of(rows), round(600 * SECOND))
    speed = repeats & (stream.inputs == Input.SPEED)
    assert 0 < stream.arrival_ns[speed].max() < 60 * SECOND < stream.arrival_ns[repeats & ~speed].max()
    ship = Ship(config_with_hold())
    for place, value in ((Input.LOAD, 1000.0), (Input.SPEED, 136.0), (Input.SPEED, np.nan)):
        ship.take('aft', place, value)
    assert ship.session.monitor.bearings['aft']._held.keys() == {Input.LOAD}


def test_any_parts_have_the_same_repeats() -> None:
    filled, _ = HeldValues(config_with_hold().bearings[0]).fill(changes_only(), T0 + round(END * SECOND))
    parts, held, stream = [], HeldValues(config_with_hold().bearings[0]), changes_only()
    for low, high in ((0, 1), (1, 2), (2, 3), (3, 4), (4, 4)):
        until = stream.arrival_ns[high - 1] if high > low else T0 + round(END * SECOND)
        columns = (column[low:high] for column in (stream.time_ns, stream.inputs, stream.value))
        part = Stream(*columns, arrival_ns=stream.arrival_ns[low:high])  # type: ignore[misc]
        parts.append(held.fill(part, int(until))[0])
    for name in ('time_ns', 'inputs', 'value', 'arrival_ns'):
        joined = np.concatenate([getattr(part, name) for part in parts])
        assert joined.tolist() == getattr(filled, name).tolist()
    assert filled.time_ns.size < 250  # of half an hour
    assert repeat_step(3600 * SECOND) == 450 * SECOND


SHIP = (ROOT / 'launch_configs' / 'reference_bearing.yaml').read_text('utf-8')


def check_log(log: Path, hold: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, Any]:
    path = log.with_name('ship.yaml')
    path.write_text(
        SHIP.replace('unit: rpm', f'unit: rpm{hold}').replace('unit: N', f'unit: N{hold}'), 'utf-8'
    )
    code = main(['check', str(log), '--config', str(path), '--json'])
    return code, json.loads(capsys.readouterr().out)


@pytest.mark.parametrize('repeats', [0, 360])
def test_the_pattern_is_named_with_the_line_to_write(
    repeats: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also where a historian then repeats the last value for an hour."""
    ramps = [(600 + k, 136.0 - 1.93 * k) for k in range(61)] + [
        (1260 + k, 20.2 + 1.93 * k) for k in range(61)
    ]
    rows = [(0, 136.0), *ramps, *((1900 + 10 * k, 136.0) for k in range(1 + repeats))]
    log = tmp_path / 'a.csv'
    log.write_text('time,speed [rpm],load [N]\n' + ''.join(f'{t},{rpm:.2f},1000\n' for t, rpm in rows))
    code, document = check_log(log, '', capsys)
    (warning,) = (text for text in document['warnings'] if 'aft_stern.speed.hold: 900' in text)
    assert 'seems to be stored only where it changes' in warning
    assert code == 1
    code, document = check_log(log, ', hold: 900', capsys)
    (bearing,) = document['bearings'].values()
    assert bearing['seconds']['undetermined'] == 0.0
    states = [event['to'] for event in bearing['events']]
    assert 'stick_slip' in states
    assert 'input_stale' not in states
    assert states[-1] == 'normal'
    assert not any('stored only' in text for text in document['warnings'])
    speed = bearing['inputs']['speed']
    assert (speed['messages'] - repeats, speed['gaps'], bearing['data']) == (124, 0, [])
    assert speed['used'] == speed['messages']


def test_a_sensor_that_was_off_is_no_source_of_changes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    times = [t for t in range(4000) if t % 1000 < 300]
    tenths = np.random.default_rng(9).integers(0, 5, 4000)
    rows = ''.join(f'{t},{136 + tenths[t] / 10:.1f},{1000 + t % 3}\n' for t in times)
    (tmp_path / 'a.csv').write_text('time,speed [rpm],load [N]\n' + rows)
    _, document = check_log(tmp_path / 'a.csv', '', capsys)
    assert not any('speed' in text and 'stored only' in text for text in document['warnings'])
