# SPDX-License-Identifier: Apache-2.0
"""Bulk reading against messages known by construction and decoded by mcap-ros2-support."""

from __future__ import annotations

import math
import struct
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from made_logs import HEADER_DEFINITION, write_recording
from mcap.records import Schema
from mcap.writer import CompressionType, IndexType, Writer
from mcap_ros2.decoder import DecoderFactory

from stickslip_logs.field_paths import NumberField, parse_field
from stickslip_logs.recordings.message_fields import FieldReader, compile_layout
from stickslip_logs.recordings.message_types import parse_schema
from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Request

DEFINITIONS = {
    'std_msgs/msg/Float64': 'float64 data\n',
    'ship_msgs/msg/Load': 'std_msgs/Header header\nfloat32 force\nint64[2] raw\n' + HEADER_DEFINITION,
    'ship_msgs/msg/Mixed': (
        'int8 LOW=-1  # a constant\n'
        'uint8 small\nbool on\nint16[<=5] few\nstring<=40 name "none"\nfloat64[] many\n'
        'byte[] raw\nuint64 large\nPart[2] parts\nchar last\nfloat64 spare\n'
        '===\nMSG: ship_msgs/Part\nuint16 id\nstring text\nEmpty nothing\nfloat64 value\n'
        '===\nMSG: ship_msgs/Empty\n'
    ),
    'ship_msgs/msg/Joints': 'std_msgs/Header header\nstring[] name\nfloat64[] velocity\n' + HEADER_DEFINITION,
}
REQUESTS = {
    'std_msgs/msg/Float64': ['data'],
    'ship_msgs/msg/Load': ['force', 'raw[1]', 'header.stamp.nanosec'],
    'ship_msgs/msg/Mixed': [
        'small',
        'on',
        'few[1]',
        'many[0]',
        'large',
        'raw[2]',
        'parts[1].value',
        'parts[0].id',
        'last',
    ],
    'ship_msgs/msg/Joints': ['velocity[1]'],
}
TYPES = list(DEFINITIONS)
TEXTS = ['', 'a', 'shaft', 'seven77', 'eight888', 'x' * 17, 'y' * 24, 'Wärme', 'z' * 300]


class Cdr:
    """Encodes CDR by the rules of the standard, in either byte order."""

    def __init__(self, big_endian: bool) -> None:
        self.order = '>' if big_endian else '<'
        self.data = bytearray()

    def put(self, code: str, *values: float) -> Cdr:
        size = struct.calcsize(code)
        for value in values:
            self.data += bytes(-len(self.data) % size) + struct.pack(self.order + code, value)
        return self

    def text(self, text: str) -> Cdr:
        raw = text.encode() + b'\0'
        self.put('I', len(raw))
        self.data += raw
        return self

    def names(self, names: list[str]) -> Cdr:
        self.put('I', len(names))
        for name in names:
            self.text(name)
        return self

    def sequence(self, code: str, values: list[Any]) -> Cdr:
        return self.put('I', len(values)).put(code, *values)

    def message(self) -> bytes:
        return bytes([0, self.order == '<', 0, 0]) + bytes(self.data)


def encode_message(type_name: str, rng: np.random.Generator, big_endian: bool) -> bytes:
    cdr = Cdr(big_endian)

    def header() -> None:
        sec = int(rng.integers(0, 2)) * int(rng.integers(-5, 2_000_000_000))
        cdr.put('i', sec).put('I', int(rng.integers(0, 2)) * 7).text(str(rng.choice(TEXTS)))

    def floats() -> list[float]:
        return [float(v) for v in rng.standard_normal(rng.integers(0, 4))]

    if type_name == 'std_msgs/msg/Float64':
        cdr.put('d', float(rng.choice([0.5, -3.25, math.inf, math.nan])))
    elif type_name == 'ship_msgs/msg/Load':
        header()
        cdr.put('f', float(rng.integers(-9, 9)) / 4)
        cdr.put('q', *[int(v) for v in rng.integers(-(2**62), 2**62, 2)])
    elif type_name == 'ship_msgs/msg/Mixed':
        cdr.put('B', int(rng.integers(0, 256))).put('B', int(rng.choice([0, 1, 2])))
        cdr.sequence('h', [int(v) for v in rng.integers(-99, 99, rng.integers(0, 5))])
        cdr.text(str(rng.choice(TEXTS)))
        cdr.sequence('d', floats())
        cdr.sequence('B', [int(v) for v in rng.integers(0, 256, rng.integers(0, 6))])
        cdr.put('Q', int(rng.integers(0, 2**63)) * 2 + 1)
        for _ in range(2):
            cdr.put('H', int(rng.integers(0, 65536))).text(str(rng.choice(TEXTS)))
            cdr.put('B', 0).put('d', float(rng.standard_normal()))
        cdr.put('b', int(rng.integers(-128, 128))).put('d', 1.0)
    else:
        header()
        # The place that is read keeps its name: which message is the first to give it one goes by the
        # order of writing, and what is expected here by time.
        cdr.names([str(rng.choice(TEXTS)), 'shaft'][: rng.integers(0, 3)]).sequence('d', floats())
    return cdr.message()


@dataclass(frozen=True)
class Written:
    topic: str
    type: str
    log_time_ns: int
    data: bytes


INDEXES = [IndexType.ALL, IndexType.NONE, IndexType.CHUNK, IndexType.MESSAGE]
OPTIONS = st.fixed_dictionaries(
    {
        'chunk_size': st.sampled_from([1, 150, 700, 5000]),
        'compression': st.sampled_from(list(CompressionType)),
        'index_types': st.sampled_from(INDEXES),
        'use_chunking': st.sampled_from([True, True, True, False]),
        'repeat_channels': st.booleans(),
        'repeat_schemas': st.booleans(),
        'use_statistics': st.booleans(),
        'use_summary_offsets': st.booleans(),
        'enable_crcs': st.booleans(),
    }
)
MESSAGES = st.lists(
    st.tuples(
        st.integers(0, 5),  # topic
        st.integers(-3, 6),  # step in time
        st.sampled_from(['whole'] * 8 + ['cut', 'noise', 'longer']),
        st.booleans(),  # big endian
    ),
    max_size=40,
)


def write_file(path: Path, options: dict[str, Any], messages: list[Written]) -> None:
    with path.open('wb') as stream:
        writer = Writer(stream, **options)
        writer.start('ros2', 'test')
        channels: dict[str, int] = {}
        for message in messages:
            if message.topic not in channels:
                definition = DEFINITIONS[message.type].encode()
                schema = writer.register_schema(message.type, 'ros2msg', definition)
                channels[message.topic] = writer.register_channel(message.topic, 'cdr', schema)
            time = message.log_time_ns
            writer.add_message(channels[message.topic], time, message.data, time)
        writer.finish()


def build_messages(
    rows: list[tuple[int, int, str, bool]], rng: np.random.Generator, start: int
) -> list[Written]:
    time, result = start, []
    for topic, step, kind, big_endian in rows:
        time += step
        type_name = TYPES[topic % len(TYPES)]
        data = encode_message(type_name, rng, big_endian)
        if kind == 'cut':
            data = data[: rng.integers(0, len(data))]
        elif kind == 'noise':
            # ASCII: whether a text is UTF-8 does not matter to numbers beside it.
            data = data[:4] + bytes(rng.integers(0, 128, len(data) - 4).tolist())
        elif kind == 'longer':
            data += bytes(5)
        result.append(Written(f'/topic{topic}', type_name, time, data))
    return result


def decode_by_reference(message: Written) -> Any:
    schema = Schema(1, DEFINITIONS[message.type].encode(), 'ros2msg', message.type)
    decoder = DecoderFactory().decoder_for('cdr', schema)
    try:
        return decoder(message.data)
    except Exception:
        return None


def expect_by_reference(
    ordered: list[Written], topics: set[str], request: Request
) -> tuple[list[tuple[int, int, int, float]], int, int]:
    """Return the rows of the reference decoder, with the counts of undecoded and short messages."""
    rows, undecoded, short = [], 0, 0
    field = NumberField(parse_field(request.field))
    requested = [message for message in ordered if message.topic in topics]
    for sequence, message in enumerate(requested):
        if message.topic != request.topic:
            continue
        decoded, value, stamp = decode_by_reference(message), math.nan, 0
        undecoded += decoded is None
        if decoded is not None:
            if hasattr(decoded, 'header'):
                stamp = decoded.header.stamp.sec * 10**9 + decoded.header.stamp.nanosec
            try:
                value = field.read(decoded)
            except LookupError:
                short += 1
        rows.append((message.log_time_ns, stamp or message.log_time_ns, sequence, value))
    return rows, undecoded, short


@pytest.mark.slow
@settings(
    max_examples=200, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large]
)
@given(files=st.lists(st.tuples(OPTIONS, MESSAGES), min_size=1, max_size=3), seed=st.integers(0, 2**32))
def test_reads_what_the_reference_decodes(
    files: list[tuple[dict[str, Any], list[tuple[int, int, str, bool]]]], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    everything: list[Written] = []
    with tempfile.TemporaryDirectory() as folder:
        for number, (options, rows) in enumerate(files):
            messages = build_messages(rows, rng, 1000 + 20 * number)
            write_file(Path(folder, f'bag_{number}.mcap'), options, messages)
            everything += messages
        ordered = sorted(everything, key=lambda message: message.log_time_ns)
        bag = open_bag(folder)
        assert bag.cuts == ()
        assert bag.message_count == len(everything)
        types = {message.topic: message.type for message in everything}
        # Some at a time: what else is asked for decides which messages can be gathered.
        requests = [
            Request(topic, field)
            for topic, name in types.items()
            for field in REQUESTS[name]
            if rng.random() < 0.3
        ]
        topics = {request.topic for request in requests}
        series = bag.read(requests)
        for request in requests:
            expected, undecoded, short = expect_by_reference(ordered, topics, request)
            actual = series[request]
            log_time, stamp, sequence, value = map(list, zip(*expected, strict=True))
            assert actual.log_time_ns.tolist() == log_time
            assert actual.stamp_ns.tolist() == stamp
            assert actual.sequence.tolist() == sequence
            np.testing.assert_array_equal(actual.value, value)
            counts = {fault.text.split("' ")[1][:6]: fault.count for fault in actual.faults}
            assert counts.get('cannot', 0) == undecoded
            assert counts.get('lack t', 0) == short
        read = [(m.topic, m.type, m.log_time_ns, m.data) for m in bag.messages()]
        assert read == [(m.topic, m.type, m.log_time_ns, m.data) for m in ordered]


@pytest.mark.parametrize('field', ['large', 'parts[0].id', 'parts[1].value', 'last', 'spare'])
def test_one_number_behind_texts_and_parts_is_that_of_the_reference(field: str, tmp_path: Path) -> None:
    """Asked for alone it is gathered from all messages at once, by the sizes of what is before it."""
    rows = [(TYPES.index('ship_msgs/msg/Mixed'), 1, 'whole', k % 2 == 1) for k in range(12)]
    messages = build_messages(rows, np.random.default_rng(3), 1000)
    write_file(tmp_path / 'bag.mcap', {}, messages)
    request = Request(messages[0].topic, field)
    expected, _, _ = expect_by_reference(messages, {request.topic}, request)
    assert open_bag(tmp_path / 'bag.mcap').read([request])[request].value.tolist() == [
        row[3] for row in expected
    ]


def test_the_message_written_first_names_the_elements(tmp_path: Path) -> None:
    messages = []
    for time, names, speeds in (
        (2000, ['rudder', 'shaft'], [0.1, 6.0]),
        (1000, ['shaft', 'rudder'], [7.0, 0.2]),
    ):
        cdr = Cdr(False).put('i', 0).put('I', 0).text('').names(names).sequence('d', speeds)
        messages.append(Written('/joints', 'ship_msgs/msg/Joints', time, cdr.message()))
    write_file(tmp_path / 'a.mcap', {}, messages)
    request = Request('/joints', 'velocity[1]')
    series = open_bag(tmp_path / 'a.mcap').read([request])[request]
    assert series.log_time_ns.tolist() == [1000, 2000]
    np.testing.assert_array_equal(series.value, [math.nan, 6.0])


def joint_message(time: int, **speeds: float) -> Written:
    cdr = Cdr(False).put('i', 0).put('I', 0).text('').names(list(speeds)).sequence('d', list(speeds.values()))
    return Written('/joints', 'ship_msgs/msg/Joints', time, cdr.message())


def test_messages_of_other_elements_are_for_others_and_no_fault(tmp_path: Path) -> None:
    # As on ``/joint_states``, where each controller publishes its own joints; live they are skipped, too.
    messages = [
        joint_message(1000, shaft=6.0),
        joint_message(2000, rudder=0.1),
        joint_message(3000, rudder=0.2, shaft=math.nan),
        joint_message(4000, rudder=0.3, shaft=8.0),
    ]
    write_file(tmp_path / 'a.mcap', {}, messages)
    requests = [Request('/joints', f'velocity[{name}]') for name in ('shaft', 'rudder', 'shfat')]
    shaft, rudder, nobody = (open_bag(tmp_path / 'a.mcap').read(requests)[request] for request in requests)
    assert shaft.log_time_ns.tolist() == [1000, 3000, 4000]
    np.testing.assert_array_equal(shaft.value, [6.0, math.nan, 8.0])
    assert rudder.sequence.tolist() == [1, 2, 3]
    assert (rudder.value.tolist(), rudder.faults, shaft.faults) == ([0.1, 0.2, 0.3], (), ())
    assert nobody.value.size == 0
    assert [fault.text for fault in nobody.faults] == [
        "4 of 4 messages of '/joints' do not name the element of field 'velocity[shfat]':"
        ' they name rudder, shaft'
    ]


def load_messages(count: int, frames: list[str]) -> list[Written]:
    result = []
    for number in range(count):
        cdr = Cdr(False).put('i', 5 + number).put('I', 3).text(frames[number % len(frames)])
        cdr.put('f', number / 4).put('q', number, -number)
        result.append(Written('/load', 'ship_msgs/msg/Load', 1000 + number, cdr.message()))
    return result


@pytest.fixture
def decoded(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Sizes of the messages that were decoded one by one."""
    sizes: list[int] = []
    decode = FieldReader._decode_alone

    def counted(self: FieldReader, data: bytes, *into: Any) -> None:
        sizes.append(len(data))
        decode(self, data, *into)

    monkeypatch.setattr(FieldReader, '_decode_alone', counted)
    return sizes


def test_numbers_behind_a_header_are_gathered(tmp_path: Path, decoded: list[int]) -> None:
    messages = load_messages(50, ['', 'shaft', 'a longer name of a frame'])
    write_file(tmp_path / 'a.mcap', {}, messages)
    request = Request('/load', 'raw[1]')
    series = open_bag(tmp_path / 'a.mcap').read([request])[request]
    assert series.value.tolist() == [-n for n in range(50)]
    assert series.stamp_ns.tolist() == [(5 + n) * 10**9 + 3 for n in range(50)]
    assert decoded == []


def test_only_the_odd_message_is_decoded_alone(tmp_path: Path, decoded: list[int]) -> None:
    messages = load_messages(9, ['a'])
    messages[4] = replace(messages[4], data=messages[4].data[:-1])
    write_file(tmp_path / 'a.mcap', {}, messages)
    request = Request('/load', 'force')
    series = open_bag(tmp_path / 'a.mcap').read([request])[request]
    assert series.value.tolist() == [
        pytest.approx(n / 4, nan_ok=True) for n in (0, 1, 2, 3, math.nan, 5, 6, 7, 8)
    ]
    assert decoded == [len(messages[4].data)]


def test_types_without_an_end_have_no_layout() -> None:
    definitions = parse_schema('a/msg/B', b'B again\nfloat64 x\n')
    assert compile_layout(definitions, 'a/msg/B', [('x',)]) is None


def test_several_channels_of_one_topic(tmp_path: Path) -> None:
    path = tmp_path / 'a.mcap'
    with path.open('wb') as stream:
        writer = Writer(stream, chunk_size=300)
        writer.start('ros2', 'test')
        schema = writer.register_schema('std_msgs/msg/Float64', 'ros2msg', b'float64 data\n')
        channels = [writer.register_channel('/x', 'cdr', schema, {'id': str(k)}) for k in range(3)]
        for number in range(60):
            data = Cdr(False).put('d', number).message()
            writer.add_message(channels[number * number % 3], 100 + number, data, 0)
        writer.finish()
    bag = open_bag(path)
    series = bag.read([Request('/x', 'data')])[Request('/x', 'data')]
    assert bag.topics['/x'].count == 60
    assert series.value.tolist() == list(range(60))
    assert series.sequence.tolist() == list(range(60))


def test_messages_are_numbered_over_all_stretches(tmp_path: Path) -> None:
    # More messages than are handed on at a time: both topics in turns, as their times are.
    times = np.arange(40_000)
    write_recording(tmp_path / 'a.mcap', {'/x': (2 * times, times), '/y': (2 * times + 1, times)})
    series_by_request = open_bag(tmp_path / 'a.mcap').read([Request('/x', 'data'), Request('/y', 'data')])
    for first, series in enumerate(series_by_request.values()):
        np.testing.assert_array_equal(series.sequence, 2 * times + first)
        np.testing.assert_array_equal(series.value, times)


def test_progress_reaches_the_total(tmp_path: Path) -> None:
    write_file(tmp_path / 'a.mcap', {'chunk_size': 200}, load_messages(30, ['a']))
    steps: list[tuple[int, int]] = []
    open_bag(tmp_path).read([Request('/load', 'force')], lambda done, total: steps.append((done, total)))
    assert len(steps) > 3
    assert steps == sorted(steps)
    assert steps[-1][0] == steps[-1][1]
