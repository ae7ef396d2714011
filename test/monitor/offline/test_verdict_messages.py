# SPDX-License-Identifier: Apache-2.0
"""Verdicts written beside the inputs: read by other readers, and held to the live monitor."""

from __future__ import annotations

import json
import struct
from collections import Counter
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_logs import write_recording
from shared import CONFIG, ROOT

from stickslip_logs.recordings import bag_recording
from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Request
from stickslip_logs.recordings.writer import BagWriter, encode_float64s, encode_stamped
from stickslip_monitor import Monitor, build_config
from stickslip_monitor.cli import main
from stickslip_monitor.monitor.bearing_records import BearingState, diagnostic_record, event_record
from stickslip_monitor.monitor.parameters import MonitorConfig
from stickslip_monitor.monitor.rule_over_arrays import Scan
from stickslip_monitor.monitor.statements import Event, Verdict
from stickslip_monitor.offline.check import CheckReport, RecordingBuffer, check_recording, to_json
from stickslip_monitor.offline.verdict_messages import VerdictWriter

NS, START = 10**9, 1_777_874_400 * 10**9
# docs/interfaces.md, by hand.
TOPICS = {
    '/stickslip_monitor/aft/amplitude': 'std_msgs/msg/Float64',
    '/stickslip_monitor/aft/amplitude_exact': 'std_msgs/msg/Float64',
    '/stickslip_monitor/aft/hopf_margin': 'std_msgs/msg/Float64',
    '/stickslip_monitor/aft/fold_margin': 'std_msgs/msg/Float64',
    '/stickslip_monitor/aft/regime': 'std_msgs/msg/String',
    '/stickslip_monitor/warnings': 'std_msgs/msg/String',
    '/diagnostics': 'diagnostic_msgs/msg/DiagnosticArray',
}


def config_of(**changes: Any) -> MonitorConfig:
    values = {
        'bearings': ['aft'],
        'aft.mass': 50.0,
        'aft.damping': 400.0,
        'aft.stiffness': 2.0e6,
        'aft.journal_diameter': 0.1,
        'aft.friction.static': 0.3,
        'aft.friction.kinetic': 0.1,
        'aft.friction.decay': 10.0,
        'aft.speed.topic': '/shaft',
        'aft.speed.unit': 'rpm',
        'aft.load.topic': '/load',
        'aft.load.type': 'geometry_msgs/msg/WrenchStamped',
        'aft.load.field': 'wrench.force.z',
        'aft.load.unit': 'N',
    }
    return build_config(values | changes)


PLAIN = {'aft.load.type': 'std_msgs/msg/Float64', 'aft.load.field': 'data'}
WRENCH = 'geometry_msgs/msg/WrenchStamped'
SAMPLES: list[tuple[int, int, float]] = [
    # A second each of speed and load: in, out, garbage, 20 s of silence on the load, and on.
    *((t, q, (60.0 if t < 10 else 20.0, 1000.0)[q]) for t in range(30) for q in (0, 1)),
    (30, 0, float('nan')),
    (31, 0, 1e9),
    *((t, 0, 60.0) for t in range(32, 52)),
    *((t, q, (60.0, 1000.0)[q]) for t in range(52, 70) for q in (0, 1)),
]


def write_samples(path: Path, samples: list[tuple[int, int, float]], period: int | None = None) -> Path:
    """Write a sample a second; the stamps of the load's headers begin again after a period [s]."""
    with BagWriter(path, chunk_size=400) as writer:
        writer.add_topic('/shaft', 'std_msgs/msg/Float64')
        writer.add_topic('/load', WRENCH)
        writer.add_topic('/other', 'std_msgs/msg/Float64')
        for second, place, value in samples:
            at, stamp = START + second * NS, START + (second % period if period else second) * NS
            if place:
                (data,) = encode_stamped(WRENCH, 'wrench.force.z', [stamp], [value])
                writer.write('/load', at, data)
            else:
                writer.write('/shaft', at, encode_float64s([value])[0])
        writer.write('/other', START, encode_float64s([1.0])[0])
    return path


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recording with garbage and silence; the load has a header."""
    return write_samples(tmp_path_factory.mktemp('bag') / 'in', SAMPLES)


@pytest.fixture(scope='module')
def written(bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('out') / 'out.mcap'
    write_verdicts(bag, path)
    return path


def write_verdicts(bag: Path, path: Path, config: MonitorConfig | None = None) -> CheckReport:
    """Check a recording and write the verdicts on it."""
    with VerdictWriter(path) as writer:
        return check_recording(bag, config or config_of(), [writer])


def scan_of(bag: Path, config: MonitorConfig) -> Scan:
    """Return the verdicts on the bearing."""
    buffer = RecordingBuffer()
    check_recording(bag, config, [buffer])
    return buffer.scan('aft')


def rosbags_messages(path: Path) -> list[tuple[str, int, Any]]:
    """Return all messages as an independent reader decodes them, by the definitions in the file."""
    from rosbags.highlevel import AnyReader

    with AnyReader([path]) as reader:
        return [
            (connection.topic, time_ns, reader.deserialize(raw, connection.msgtype))
            for connection, time_ns, raw in reader.messages()
        ]


def monitor_live(until: int | None = None) -> tuple[list[Verdict], list[Event], Monitor]:
    """Feed the same samples one by one to the monitor as the node uses it."""
    monitor = Monitor(config_of())
    verdicts, events = [], monitor.advance(START)
    for second, place, value in SAMPLES:
        if until is not None and second > until:
            break
        update = monitor.bearings['aft'].update(place, START + second * NS, value)
        verdicts += [update.verdict] if update.verdict else []
        events += update.events
    if until is not None:
        events += monitor.advance(START + until * NS)
    return verdicts, events, monitor


@pytest.mark.slow
def test_topics_are_those_of_the_node_beside_the_inputs(written: Path) -> None:
    types = {name: topic.type for name, topic in open_bag(written).topics.items()}
    inputs = {'/shaft': 'std_msgs/msg/Float64', '/load': WRENCH}
    assert types == TOPICS | inputs


@pytest.mark.slow
def test_another_reader_decodes_the_verdicts_of_the_live_monitor(written: Path) -> None:
    verdicts, events, _ = monitor_live()
    messages = rosbags_messages(written)
    for name, value in (
        ('amplitude', lambda p: 0.0 if np.isnan(p.amplitude) else p.amplitude),
        ('hopf_margin', lambda p: p.hopf_margin),
        ('fold_margin', lambda p: p.fold_margin),
        ('regime', lambda p: p.regime.value),
    ):
        values = [(t, m.data) for topic, t, m in messages if topic == f'/stickslip_monitor/aft/{name}']
        assert values == [(v.time_ns, value(v.assessment)) for v in verdicts]
    # In bulk and one by one the exact amplitude may come by different ways, alike to 1e-6.
    exact = [(t, m.data) for topic, t, m in messages if topic.endswith('/amplitude_exact')]
    times, amplitudes = zip(*exact, strict=True)
    assert list(times) == [v.time_ns for v in verdicts]
    alone = np.nan_to_num([v.assessment.amplitude_exact for v in verdicts])
    np.testing.assert_allclose(amplitudes, alone, rtol=1e-6)
    assert alone.max() > 0.0
    warnings = [(t, json.loads(m.data)) for topic, t, m in messages if topic.endswith('/warnings')]
    assert warnings == [(e.time_ns, event_record(e)) for e in events]
    assert {'stick_slip', 'input_stale'} <= {record['to'] for _, record in warnings}


def test_inputs_are_copied_byte_by_byte_with_their_times(bag: Path, written: Path) -> None:
    inputs, copies = (
        [(m.topic, m.log_time_ns, m.data) for m in open_bag(path).messages(['/shaft', '/load'])]
        for path in (bag, written)
    )
    assert copies == inputs


def test_our_reader_gives_the_same_check_again(bag: Path, written: Path) -> None:
    reports = (check_recording(path, config_of()) for path in (bag, written))
    first, second = (list(map(event_record, report.bearings['aft'].events)) for report in reports)
    assert first == second
    request = Request('/stickslip_monitor/aft/fold_margin', 'data', 'std_msgs/msg/Float64')
    series = open_bag(written).read([request])[request]
    expected = scan_of(written, config_of()).assessment.fold_margin
    np.testing.assert_array_equal(series.value, expected)


def test_diagnostics_are_those_of_the_live_monitor(written: Path) -> None:
    arrays = {t: m for topic, t, m in rosbags_messages(written) if topic == '/diagnostics'}
    seconds = [t for t in arrays if (t - START) % NS == 0]
    assert seconds == [START + s * NS for s in range(70)]
    for second in (0, 5, 12, 29, 31, 36, 45, 51, 52, 69):
        _, _, monitor = monitor_live(second)
        state = BearingState(monitor.bearings['aft'])
        expected = diagnostic_record('stickslip_monitor', state)
        message = arrays[START + second * NS]
        assert message.header.stamp.sec * NS + message.header.stamp.nanosec == START + second * NS
        (status,) = message.status
        assert (status.level, status.name, status.hardware_id) == (
            state.severity,
            'stickslip_monitor: aft',
            'aft',
        )
        assert {pair.key: pair.value for pair in status.values} == expected.values
        assert status.message == state.message


def test_blocks_of_a_few_messages_give_the_same_file_and_check(
    bag: Path, written: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = to_json(check_recording(bag, config_of()))
    monkeypatch.setattr(bag_recording, '_MAX_OF_TOPIC', 2)
    assert to_json(write_verdicts(bag, tmp_path / 'out.mcap')) == expected
    in_large_blocks, in_small_blocks = (
        sorted((m.topic, m.log_time_ns, m.data) for m in open_bag(path).messages())
        for path in (written, tmp_path / 'out.mcap')
    )
    # The exact amplitude comes by another way where there are few: see the test above.
    amplitudes = [
        [struct.unpack('<4xd', data) for topic, _, data in messages if topic.endswith('/amplitude_exact')]
        for messages in (in_large_blocks, in_small_blocks)
    ]
    np.testing.assert_allclose(*amplitudes, rtol=1e-6)
    assert [m[:2] for m in in_large_blocks] == [m[:2] for m in in_small_blocks]
    in_large_blocks, in_small_blocks = (
        [m for m in messages if not m[0].endswith('/amplitude_exact')]
        for messages in (in_large_blocks, in_small_blocks)
    )
    assert in_large_blocks == in_small_blocks


def test_a_publish_period_thins_the_values_and_keeps_the_changes(bag: Path, tmp_path: Path) -> None:
    config = config_of(publish_period=5.0)
    written = write_verdicts(bag, tmp_path / 'out.mcap', config)
    regimes = open_bag(tmp_path / 'out.mcap').messages(['/stickslip_monitor/aft/regime'])
    times = [message.log_time_ns for message in regimes]
    changes = {event.time_ns for event in written.bearings['aft'].events}
    assert len(times) < 30
    early = [b for a, b in pairwise(times) if b - a < 5 * NS]
    scan = scan_of(bag, config)
    # What comes early is the first evaluation at or after a change.
    firsts = {int(t) for c in changes for t in scan.time_ns[scan.time_ns >= c][:1]}
    assert early
    assert set(early) <= firsts


def test_a_quiet_recording_has_its_diagnostics(tmp_path: Path) -> None:
    """Without a change of the alarm, which would be the only times not on the grid."""
    times = START + np.arange(50) * 10**8
    columns = {'/shaft': (times, np.full(50, 60.0)), '/load': (times, np.full(50, 1000.0))}
    write_recording(tmp_path / 'in', columns)
    config = config_of(**PLAIN)
    written = write_verdicts(tmp_path / 'in', tmp_path / 'out.mcap', config)
    assert written.bearings['aft'].events == []
    assert open_bag(tmp_path / 'out.mcap').topics['/diagnostics'].count == 5


def test_values_that_stand_are_the_same_in_any_blocks_and_are_no_samples(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    samples = [
        (0, 1, 1000.0),
        *((t, 0, rpm) for t, rpm in ((0, 60.0), (100, 20.0), (101, 20.5), (400, 60.0))),
    ]
    write_samples(tmp_path / 'in', [*samples, (500, 0, 61.0)])
    config = config_of(**{'aft.speed.hold': 900.0, 'aft.load.hold': 900.0})
    report = write_verdicts(tmp_path / 'in', tmp_path / 'out.mcap', config)
    monkeypatch.setattr(bag_recording, '_MAX_OF_TOPIC', 2)
    assert to_json(write_verdicts(tmp_path / 'in', tmp_path / 'again.mcap', config)) == to_json(report)
    in_large_blocks, in_small_blocks = (
        {(t, n): m for t, n, m in rosbags_messages(tmp_path / f'{p}.mcap')} for p in ('out', 'again')
    )
    assert in_large_blocks.keys() == in_small_blocks.keys()
    last = max(t for topic, t in in_large_blocks if topic == '/diagnostics')
    values = {pair.key: pair.value for pair in in_large_blocks['/diagnostics', last].status[0].values}
    assert (values['speed samples accepted'], values['speed samples repeated']) == ('5', '0')
    assert {event.after.value for event in report.bearings['aft'].events} >= {'stick_slip', 'normal'}


def test_a_mix_of_two_sources_is_no_all_clear_for_a_minute(tmp_path: Path) -> None:
    """Two of 1000 and two of 20 rpm in turn for 10 s, then 60 rpm: as on the page of a running node."""
    times, turn = START + np.arange(800) * 10**8, np.arange(800)
    rpm = np.where(turn < 100, np.where(turn % 4 < 2, 20.0, 1000.0), 60.0)
    write_recording(tmp_path / 'in', {'/shaft': (times, rpm), '/load': (times, np.full(800, 1000.0))})
    config = config_of(**PLAIN)
    write_verdicts(tmp_path / 'in', tmp_path / 'out.mcap', config)
    texts = [
        (t - START, m) for topic, t, m in rosbags_messages(tmp_path / 'out.mcap') if topic == '/diagnostics'
    ]
    mixed = {t // NS for t, m in texts if 'No verdict can be relied on.' in m.status[0].message}
    assert mixed.issuperset(range(5, 70))
    assert not mixed & {0, 1, 2, *range(71, 80)}
    assert all(m.status[0].level == 0 for t, m in texts if t >= 71 * NS)


@pytest.mark.parametrize('number', [-999.25, 30e3])
def test_refused_samples_are_no_second_source(tmp_path: Path, number: float) -> None:
    times = START + np.arange(300) * 10**8
    rpm = np.where(np.arange(300) % 3, 60.0, number)
    write_recording(tmp_path / 'in', {'/shaft': (times, rpm), '/load': (times, np.full(300, 1000.0))})
    config = config_of(**PLAIN)
    speed = check_recording(tmp_path / 'in', config).bearings['aft'].inputs[0]
    assert (speed.used, speed.sources) == (200, ())


def test_a_clock_that_jumps_back_is_written(tmp_path: Path) -> None:
    samples = [(second, place, (20.0, 1000.0)[place]) for second in range(60) for place in (1, 0)]
    written = write_verdicts(write_samples(tmp_path / 'in', samples, period=30), tmp_path / 'out.mcap')
    counts = Counter(topic for topic, _, _ in rosbags_messages(tmp_path / 'out.mcap'))
    assert counts['/stickslip_monitor/aft/regime'] == written.bearings['aft'].evaluations


# --- the command -------------------------------------------------------------------------------


def run_check(*arguments: object) -> int:
    return main(['check', *map(str, arguments), '--config', str(CONFIG)])


@pytest.mark.slow
def test_the_command_writes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / 'out.mcap'
    assert run_check(ROOT / 'bags' / 'coast_down', '--mcap', out, '--json') == 1
    document = json.loads(capsys.readouterr().out)['bearings']['aft_stern']
    topics = open_bag(out).topics
    assert topics['/stickslip_monitor/warnings'].count == len(document['events'])
    assert topics['/stickslip_monitor/aft_stern/amplitude'].count == document['evaluations']
