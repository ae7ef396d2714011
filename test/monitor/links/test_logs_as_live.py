# SPDX-License-Identifier: Apache-2.0
"""A voyage that was recorded from a bus is judged as it was live, source by source."""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Iterator
from functools import reduce
from operator import xor
from pathlib import Path

import pytest

from fuzz.ships import (
    BEARING,
    LISTEN,
    OWN_VESSEL,
    Lines,
    Sample,
    Signal,
    differences,
    lines_of,
    random_differences,
    random_voyage,
    sentence_line,
    stamp_of,
)
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.monitor.statements import Event
from stickslip_monitor.offline.check import check_recording

SPEED, LOAD = Signal(False, 0), Signal(True, 0)


def make_voyage(rename_at: float = 60.0, overlap: float = 0.0) -> list[Sample]:
    """Return 60 s at 136 rpm, then stick-slip at 20 rpm, while a spare sender takes over the speed."""
    samples = []
    for k in range(240):
        t, value = 0.5 * k, 136.0 if k < 120 else 20.0
        samples += [Sample(t, 'II', SPEED, value)] * (t < rename_at)
        samples += [Sample(t, 'ER', SPEED, value + 0.5)] * (t >= rename_at - overlap)
        samples.append(Sample(t, 'II', LOAD, 1000.0 + k % 7))
    return samples


def rough_nmea_lines(seed: int, samples: list[Sample]) -> Iterator[tuple[float, str]]:
    """Sentences as rough wires bring them: damaged, joined, without a unit, of other kinds between them."""
    chance = random.Random(seed)
    for t, line in lines_of('nmea', samples):
        head, _, text = line.rstrip().partition(' ')
        talker, fields = text[1:3], text[3:-3].split(',')
        bodies = {
            'exponent': [*fields[: 1 if 'XDR' in fields else 3], '1e2', '30.0', 'A'],
            'leading zero': [*fields[:2], f'0{fields[2]}', *fields[3:]] if fields[0] == 'RPM' else fields,
            'no unit': [*fields[:3], '', *fields[4:]] if fields[0] == 'XDR' else fields,
            'pressure': ['XDR', 'P', '3.1', 'B', 'LOAD0'],
            'engine': ['RPM', 'E', '1', '500.0', '', 'A'],
            'position': ['GGA', '1', '2', '3'],
            'twice': [*fields, 'N', '1700.0', 'N', 'LOAD0'] if fields[0] == 'XDR' else fields,
        }
        kind = chance.choice([*bodies, *['plain'] * 20])
        body = talker + ','.join(bodies.get(kind, fields))
        text = f'${body}*{reduce(xor, body.encode()):02X}'
        cut = chance.randrange(1, len(text))
        text = chance.choice([text] * 20 + [text[:cut], text.replace('*', '', 1), text + text])
        yield t, f'{head} {text}\r\n'


def rough_signalk_lines(seed: int, samples: list[Sample]) -> Iterator[tuple[float, str]]:
    """Deltas of several kinds: other vessels, words, nameless values, damaged lines, sources as objects."""
    chance = random.Random(seed)
    for t, line in lines_of('signalk', samples):
        frame = json.loads(line)
        if 'updates' in frame and chance.random() < 0.3:
            (update,) = frame['updates']
            (value,) = update['values']
            kind = chance.randrange(6)
            frame |= {'context': 'vessels.urn:mrn:imo:mmsi:1'} if kind == 0 else {}
            frame |= {'context': 'vessels.self'} if kind == 1 else {}
            value['value'] = chance.choice(['12', True, [1]]) if kind == 2 else value['value']
            update['values'] += [{'path': '', 'value': 3.0}] * (kind == 3)
            if kind == 4:
                update['source'] = {'label': update.pop('$source')}
            line = json.dumps(frame) + '\n'
            line = line[: len(line) // 2] + '\n' if kind == 5 else line
        yield t, line


def ship_file(folder: Path, bus: str, *, has_columns: bool = True, **changes: object) -> Path:
    """Write the parameters of a ship of one bearing; ``changes`` are of its inputs, as ``speed__hold``."""
    inputs: dict[str, dict[str, object]] = {
        'speed': {'unit': 'rpm' if bus == 'nmea' else 'Hz'},
        'load': {'unit': 'N'},
    }
    for quantity, signal in (('speed', SPEED), ('load', LOAD)):
        source = {'column': signal.column[bus]} if has_columns else {'topic': f'/{quantity}'}
        inputs[quantity] |= source
    for name, value in changes.items():
        quantity, _, key = name.partition('__')
        inputs[quantity][key] = value
    links = LISTEN[bus] | {'aft.speed': SPEED.link(bus), 'aft.load': LOAD.link(bus)}
    document = {
        '/**': {'ros__parameters': {'bearings': ['aft'], 'aft': BEARING | inputs}},
        '/stickslip_links': {'ros__parameters': links},
    }
    path = folder / 'ship.yaml'
    path.write_text(json.dumps(document))
    return path


def check_equal_events(
    folder: Path, bus: str, lines: Lines, **changes: object
) -> tuple[list[Event], str, str]:
    """Check that both have the same events; return these, and the warnings of each about sources."""
    differing, report, live = differences(folder, ship_file(folder, bus, **changes), bus, lines)
    assert differing == []
    (bearing,) = report.bearings.values()
    offline = [text for text in report.bag.warnings if ': source ' in text]
    return bearing.events, ' | '.join(offline), ' | '.join(live)


def words_of(events: list[Event]) -> list[str]:
    return [event.after.name for event in events]


@pytest.mark.parametrize('bus', ['nmea', 'signalk'])
@pytest.mark.parametrize(
    'make', [make_voyage, lambda: make_voyage(30.0), lambda: make_voyage(80.0, overlap=40.0)]
)
def test_a_spare_sender_takes_over(bus: str, make: Callable[[], list[Sample]], tmp_path: Path) -> None:
    events, offline, live = check_equal_events(tmp_path, bus, lines_of(bus, make()))
    assert 'STICK_SLIP' in words_of(events)
    assert "source 'ER' is used; 'II' has sent no number for " in offline
    assert "source 'ER' is used; 'II' has sent no number for " in live


@pytest.mark.parametrize('chosen', ['II', 'ER'])
@pytest.mark.parametrize('has_columns', [True, False])
@pytest.mark.parametrize('bus', ['nmea', 'signalk'])
def test_a_chosen_sender_is_the_only_one(bus: str, has_columns: bool, chosen: str, tmp_path: Path) -> None:
    """Hear nothing of the other sender, which is the first, and goes on at 136 rpm."""
    samples = [
        sample
        for t in range(120)
        for sample in (
            Sample(t + 0.0, 'GP', SPEED, 136.0 + 0.01 * t),
            Sample(t + 0.2, chosen, SPEED, (136.0 if t < 60 else 20.0) + 0.01 * t),
            Sample(t + 0.4, 'GP', LOAD, 1000.0 + t % 7),
        )
    ]
    path = ship_file(tmp_path, bus, has_columns=has_columns)
    document = json.loads(path.read_text())
    key = 'talker' if bus == 'nmea' else 'source'
    document['/stickslip_links']['ros__parameters']['aft.speed'] |= {key: chosen}
    path.write_text(json.dumps(document))
    differing, report, live = differences(tmp_path, path, bus, lines_of(bus, samples))
    assert differing == []
    assert 'STICK_SLIP' in words_of(report.bearings['aft'].events)
    for texts in (live, report.bag.warnings):
        assert any(f"source 'GP' is left out: '{chosen}' is chosen" in text for text in texts)


@pytest.mark.parametrize('bus', ['nmea', 'signalk'])
def test_a_sender_whose_values_stand_is_given_up_later(bus: str, tmp_path: Path) -> None:
    """Half of the hold, where that is longer than the time-out: 30 s behind its last value."""
    _, offline, _ = check_equal_events(tmp_path, bus, lines_of(bus, make_voyage()), speed__hold=60.0)
    assert "source 'ER' is used; 'II' has sent no number for 30.5 s" in offline


def test_bearings_of_one_shaft_have_a_sender_each_by_their_time_outs(tmp_path: Path) -> None:
    path = ship_file(tmp_path, 'nmea')
    document = json.loads(path.read_text())
    parameters, links = (document[name]['ros__parameters'] for name in ('/**', '/stickslip_links'))
    parameters['bearings'] = ['aft', 'mid']
    parameters['mid'] = parameters['aft'] | {'speed': parameters['aft']['speed'] | {'timeout': 20.0}}
    links |= {f'mid.{quantity}': links[f'aft.{quantity}'] for quantity in ('speed', 'load')}
    path.write_text(json.dumps(document))
    lines = lines_of(
        'nmea', [sample for sample in make_voyage(80.0) if sample.source == 'II' or sample.time > 85.0]
    )
    differing, report, _ = differences(tmp_path, path, 'nmea', lines)
    assert differing == []
    lost = ['INPUT_STALE' in words_of(report.bearings[name].events) for name in ('aft', 'mid')]
    assert lost == [True, False]


def in_other_units(lines: Lines, since: float) -> Iterator[tuple[float, str]]:
    """Yield lines with meta data from a time [s] on by which speeds are in rpm and loads in kN."""
    units = {SPEED.column['signalk']: ('rpm', 60.0), LOAD.column['signalk']: ('kN', 1e-3)}
    meta = [{'path': path, 'value': {'units': unit}} for path, (unit, _) in units.items()]
    yield lines[0]
    has_begun = False
    for t, line in lines[1:]:
        delta = json.loads(line)
        if t >= since:
            if not has_begun:
                has_begun = True
                update = {'timestamp': stamp_of(t), 'meta': meta}
                yield t, json.dumps({'context': OWN_VESSEL, 'updates': [update]}) + '\n'
            (item,) = delta['updates'][0]['values']
            item['value'] *= units[item['path']][1]
        yield t, json.dumps(delta) + '\n'


@pytest.mark.parametrize('since', [0.0, 30.0, 90.0])
def test_units_of_meta_data_are_converted(since: float, tmp_path: Path) -> None:
    lines = lines_of('signalk', make_voyage())
    events, _, _ = check_equal_events(tmp_path, 'signalk', lines)
    converted, _, live = check_equal_events(tmp_path, 'signalk', list(in_other_units(lines, since)))
    assert [(e.after, e.time_ns) for e in converted] == [(e.after, e.time_ns) for e in events]
    assert "its unit is 'kN', converted to N" in live


# At once those that were judged otherwise: values that stand, time-outs that differ on one shaft.
@pytest.mark.parametrize(
    ('bus', 'seed'),
    [('nmea', 0), ('nmea', 12), ('signalk', 11)]
    + [
        pytest.param(bus, seed, marks=pytest.mark.slow)
        for bus in ('nmea', 'signalk')
        for seed in range(20, 26)
    ],
)
def test_random_ships(bus: str, seed: int, tmp_path: Path) -> None:
    assert random_differences(tmp_path, bus, seed) == []


@pytest.mark.parametrize('bus', ['nmea', 'signalk'])
@pytest.mark.parametrize('seed', [100, 101, 102, 104])
@pytest.mark.slow
def test_rough_random_voyages(bus: str, seed: int, tmp_path: Path) -> None:
    rough = rough_nmea_lines if bus == 'nmea' else rough_signalk_lines
    check_equal_events(tmp_path, bus, list(rough(seed, random_voyage(random.Random(seed), (SPEED, LOAD)))))


@pytest.mark.parametrize('every', [3.0, 8.0])
def test_a_slow_bus_is_lost_as_live(every: float, tmp_path: Path) -> None:
    # A value each 8 s is older than 5 s, on board and in the log.
    samples = [
        Sample(every * k, 'II', signal, 900.0 if signal.is_load else 136.0)
        for k in range(30)
        for signal in (SPEED, LOAD)
    ]
    events, _, _ = check_equal_events(tmp_path, 'nmea', lines_of('nmea', samples))
    assert ('INPUT_STALE' in words_of(events)) == (every > 5.0)


def test_a_bus_goes_on_where_its_speed_and_load_end(tmp_path: Path) -> None:
    lines = [*lines_of('nmea', [sample for sample in make_voyage() if sample.time < 50.0])]
    lines += [sentence_line(t, 'GPGGA,1,2,3') for t in range(50, 100)]
    events, _, _ = check_equal_events(tmp_path, 'nmea', lines)
    assert words_of(events) == ['INPUT_STALE']


@pytest.mark.parametrize('bus', ['nmea', 'signalk'])
def test_the_other_sender_is_no_second_column(bus: str, tmp_path: Path) -> None:
    (tmp_path / 'a.log').write_text(''.join(line for _, line in lines_of(bus, make_voyage())), newline='')
    config = load_config(ship_file(tmp_path, bus, has_columns=False))
    (bearing,) = check_recording(tmp_path / 'a.log', config).bearings.values()
    assert 'STICK_SLIP' in words_of(bearing.events)
