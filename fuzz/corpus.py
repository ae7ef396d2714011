# SPDX-License-Identifier: Apache-2.0
"""Odd recordings, each with what ``stickslip check`` has to say of it."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass

import lz4.frame
import zstandard
from mcap.records import Chunk, MessageIndex

from fuzz.files import (
    DEFINITIONS,
    HEAD,
    LOAD,
    MAGIC,
    SPEED,
    START,
    STEP,
    Piece,
    channel,
    encode_record,
    file,
    message,
    messages,
    raw_record,
    schema,
    sound,
)


@dataclass(frozen=True)
class Odd:
    """A file, what is said of it, and how many messages of each input can be read."""

    make: Callable[[], bytes]
    says: str
    speed: int = 0
    load: int = 0


def _surround_pieces(*middle: Piece) -> list[Piece]:
    return [Piece([*DEFINITIONS, *messages(0)]), *middle, Piece(messages(40))]


def _make_bomb(compression: str, size: int, declared: int | None = None) -> bytes:
    """Return a chunk of a few kilobytes that decompresses to one large record of an unknown kind."""
    head, zeros = HEAD.pack(0x80, size - HEAD.size), bytes(1 << 20)
    blocks = [zeros] * ((size - HEAD.size) // len(zeros)) + [zeros[: (size - HEAD.size) % len(zeros)]]
    if compression == 'zstd':
        packer = zstandard.ZstdCompressor(level=1).compressobj()
        data = b''.join([packer.compress(part) for part in (head, *blocks)] + [packer.flush()])
    else:
        frame = lz4.frame.LZ4FrameCompressor()
        parts = [frame.begin(), *(frame.compress(part) for part in (head, *blocks)), frame.flush()]
        data = b''.join(parts)
    chunk = Chunk(
        compression=compression,
        data=data,
        message_end_time=START,
        message_start_time=START,
        uncompressed_crc=0,
        uncompressed_size=size if declared is None else declared,
    )
    return encode_record(chunk)


def _with_chunk(record: bytes) -> bytes:
    """Return a sound file without a summary, with one more chunk in front of its data's end."""
    data = sound(summary=False)
    end = data.index(raw_record(0x0F, bytes(4)))
    return data[:end] + record + data[end:]


def _tiny_messages() -> bytes:
    """Return ten million messages without data in one chunk of some kilobytes."""
    return _with_chunk(_grow_chunk((raw_record(5, struct.pack('<HIQQ', 1, 0, START, START)) * 100_000, 100)))


def _grow_chunk(*parts: tuple[bytes, int]) -> bytes:
    """Return a chunk of records, each repeated so often, that takes some kilobytes in the file."""
    size = sum(len(data) * count for data, count in parts)
    packer = zstandard.ZstdCompressor(level=1).compressobj(size=size)
    pieces = [packer.compress(data) for data, count in parts for _ in range(count)]
    chunk = Chunk(
        compression='zstd',
        data=b''.join([*pieces, packer.flush()]),
        message_end_time=START,
        message_start_time=START,
        uncompressed_crc=0,
        uncompressed_size=size,
    )
    return encode_record(chunk)


def _long_record(kind: int, head: bytes, text: bytes, tail: bytes = b'') -> bytes:
    """Return a definition of 100 MiB in a chunk; its text is repeated."""
    count = (100 << 20) // len(text)
    size = len(head) + count * len(text) + len(tail)
    return _grow_chunk((HEAD.pack(kind, size) + head, 1), (text, count), (tail, 1))


def _long_schema(number: int) -> bytes:
    name = b'a/msg/Long'
    size = (100 << 20) // 10 * 10
    head = struct.pack('<HI', number, len(name)) + name + struct.pack('<I', 7) + b'ros2msg'
    return _long_record(3, head + struct.pack('<I', size), b'float64 x\n')


def _long_name(number: int) -> bytes:
    head = struct.pack('<HHI', number, 1, 100 << 20)
    return _long_record(4, head, b'/abc', struct.pack('<I', 3) + b'cdr' + bytes(4))


def _equal_times(payload: bytes) -> bytes:
    """Return three million messages of one time."""
    return _grow_chunk((raw_record(5, struct.pack('<HIQQ', 1, 0, START, START) + payload) * 3000, 1000))


def _redefined_often() -> bytes:
    """65,000 channels, one of which changes its meaning in each of 300 chunks."""
    many = [channel(number, f'/topic{number}') for number in range(3, 65_003)]
    changes = [Piece([channel(9, f'/other{k}'), message(9, START, 0.0)]) for k in range(300)]
    return file([Piece([*DEFINITIONS, *messages(0, 60), *many]), *changes], summary=False)


def _late_redefinition(record: bytes) -> bytes:
    """Return a definition that cannot be right in the last of three chunks."""
    pieces = [Piece([*DEFINITIONS, *messages(0)]), Piece(messages(20))]
    return file([*pieces, Piece([record, *messages(40)])], summary=False)


def _many_indexes() -> bytes:
    data = sound(summary=False)
    end = data.index(raw_record(0x0F, bytes(4)))
    index = encode_record(MessageIndex(channel_id=1, records=[]))
    return data[:end] + index * 400_000 + data[end:]


def _many_channels() -> bytes:
    more = [channel(number, f'/topic{number}') for number in range(3, 40_003)]
    odd_messages = [message(number, START, 0.0) for number in range(3, 40_003)]
    first = Piece([*DEFINITIONS, *messages(0), *more, *odd_messages])
    return file([first, Piece(messages(20, 40))], summary=False)


def _many_schemas() -> bytes:
    """Return long definitions of unused topics, and one line of 5,000 digits."""
    long = b''.join(b'float64 field_%d\n' % k for k in range(100_000))
    records = [schema(9, 'a/msg/Long', long), channel(9, '/long', 9)]
    records += [
        schema(10, 'a/msg/Odd', b'float64[' + b'9' * 5000 + b'] x\nfloat64[<=] y\n'),
        channel(10, '/odd', 10),
    ]
    return file([Piece([*DEFINITIONS, *records, *messages(0)]), Piece(messages(20, 40))])


def _long_definition() -> bytes:
    long = b'float64 data\n' + b''.join(b'float64 field_%d\n' % k for k in range(100_000))
    definitions = (schema(1, 'std_msgs/msg/Float64', long), *DEFINITIONS[1:])
    return file([Piece([*definitions, *messages(0, 60)])], definitions)


def _with_definition(text: bytes) -> bytes:
    definitions = (schema(1, 'std_msgs/msg/Float64', text), *DEFINITIONS[1:])
    return file([Piece([*definitions, *messages(0, 60)])], definitions)


def _bad_name() -> bytes:
    """Return a channel whose name is not UTF-8, in the middle of a chunk."""
    broken = channel(7, 'xyz').replace(b'xyz', b'\xff\xfe\xfd')
    return file(_surround_pieces(Piece([*messages(20, 10), broken, *messages(30, 10)])), summary=False)


def _damaged_chunk() -> bytes:
    data = bytearray(sound('zstd'))
    spot = data.index(b'zstd') + 60
    data[spot] ^= 0xFF
    return bytes(data)


def _all_damaged() -> bytes:
    piece = Piece([*DEFINITIONS, *messages(0, 60)], changes={'uncompressed_crc': 1})
    return file([piece])


def _messages_at(time_ns: int) -> bytes:
    middle = [*messages(20), message(1, time_ns, 30.0), message(2, time_ns, 1000.0)]
    return file(_surround_pieces(Piece(middle)))


def _with_encapsulation(kind: int) -> bytes:
    head = struct.pack('>H', kind) + b'\0\0'
    middle = [message(1, START + k * STEP, 30.0, head) for k in range(20, 40)]
    return file(_surround_pieces(Piece(middle)))


def _moved_summary() -> bytes:
    """Return a footer that says that the summary begins at the first chunk, which is damaged."""
    data = bytearray(_damaged_chunk())
    first = data.index(b'zstd') - 45
    footer = len(data) - 8 - 20
    data[footer : footer + 8] = struct.pack('<Q', first)
    return bytes(data)


_LIMIT = 'bytes, the limit for its size'
_ALL = '60 messages in 5.9 s'
_OTHERWISE = 'defines a channel or its type otherwise than before'
_SWAPPED = (schema(), channel(1, LOAD), channel(2, SPEED))

ODD: dict[str, Odd] = {
    'sound': Odd(sound, _ALL, 30, 30),
    'sound zstd': Odd(lambda: sound('zstd'), _ALL, 30, 30),
    'sound lz4': Odd(lambda: sound('lz4'), _ALL, 30, 30),
    'no summary': Odd(lambda: sound(summary=False), _ALL, 30, 30),
    'index lacks a channel': Odd(
        lambda: file(_surround_pieces(Piece(messages(20), left_out=frozenset({1})))), _ALL, 30, 30
    ),
    'index lacks entries': Odd(
        lambda: file(_surround_pieces(Piece(messages(20), most_entries=5))), _ALL, 30, 30
    ),
    'index and statistics lack entries': Odd(
        lambda: file(_surround_pieces(Piece(messages(20), most_entries=5)), counts={1: 25, 2: 25}),
        "counts 25 messages of '" + SPEED,
        30,
        30,
    ),
    'statistics count more': Odd(
        lambda: file(_surround_pieces(Piece(messages(20))), counts={1: 31, 2: 30}),
        f"counts 31 messages of '{SPEED}', and 30 can be read",
        30,
        30,
    ),
    'name that is no UTF-8': Odd(_bad_name, 'has 1 record that cannot be read: skipped', 30, 30),
    'record of kind 0 in a chunk': Odd(
        lambda: file(_surround_pieces(Piece([*messages(20, 10), raw_record(0, b'odd'), *messages(30, 10)]))),
        'has 1 record that cannot be read: skipped',
        30,
        30,
    ),
    'record of kind 0 in a bare run': Odd(
        lambda: file(
            [Piece([*DEFINITIONS, *messages(0, 30), raw_record(0, b'odd'), *messages(30, 30)], is_bare=True)],
            summary=False,
        ),
        'is truncated in the record at byte',
        15,
        15,
    ),
    'message shorter than its head': Odd(
        lambda: file(_surround_pieces(Piece([*messages(20, 10), raw_record(5, b'odd'), *messages(30, 10)]))),
        'has 1 record that cannot be read: skipped',
        30,
        30,
    ),
    'bytes at the end of a chunk': Odd(
        lambda: file(_surround_pieces(Piece([*messages(20), b'\x05' + b'\xff' * 20]))),
        'has 21 bytes at its end, no record',
        30,
        30,
    ),
    'joined files': Odd(
        lambda: (
            file([Piece([*DEFINITIONS, *messages(0, 30)])])
            + file([Piece([*_SWAPPED, *messages(30, 30, swapped=True)])], _SWAPPED)
        ),
        'behind its end, not read',
        15,
        15,
    ),
    'a cut file joined to another': Odd(
        lambda: sound(summary=False)[:-200] + file([Piece([*_SWAPPED, *messages(60, 20, True)])]),
        'is truncated',
        30,
        30,
    ),
    'bytes behind the end': Odd(lambda: sound() + b'something else', 'has 14 bytes behind its end', 30, 30),
    'channels that change their meaning': Odd(
        lambda: file(
            _surround_pieces(Piece([channel(1, LOAD), channel(2, SPEED), *messages(20, 40, True)]))[:2]
        ),
        _OTHERWISE,
        10,
        10,
    ),
    'channels that change inside a chunk': Odd(
        lambda: file(
            _surround_pieces(Piece([*messages(20, 10), *_SWAPPED[1:], *messages(30, 10, True)]))[:2]
        ),
        _OTHERWISE,
        10,
        10,
    ),
    'a channel changes beside a third topic': Odd(
        lambda: file(
            [
                Piece([*DEFINITIONS, channel(3, '/other'), *messages(0)]),
                Piece(
                    [
                        *messages(20, 10),
                        message(3, START + 25 * STEP, 0.0),
                        channel(1, '/odd'),
                        *messages(30, 10),
                    ]
                ),
            ],
            summary=False,
        ),
        _OTHERWISE,
        10,
        20,
    ),
    'a channel of no input is redefined': Odd(
        lambda: file(
            [
                Piece(
                    [*DEFINITIONS, channel(3, '/other'), *messages(0), channel(3, '/odd'), *messages(20, 40)]
                )
            ],
            summary=False,
        ),
        f"{_OTHERWISE}: messages of '/other' from there on",
        30,
        30,
    ),
    'a channel that nothing defines': Odd(
        lambda: file(
            _surround_pieces(Piece([*messages(20), message(7, START + 20 * STEP, 1.0)])), summary=False
        ),
        '1 message of channel 7, which is defined nowhere, were not read',
        30,
        30,
    ),
    'an index that names a message twice': Odd(
        lambda: file(_surround_pieces(Piece(messages(20), repeated=True))), _ALL, 30, 30
    ),
    'a late definition of another type': Odd(
        lambda: _late_redefinition(schema(1, 'std_msgs/msg/Float32', b'float32 data\n')), _OTHERWISE, 20, 20
    ),
    'a late definition that is no text': Odd(
        lambda: _late_redefinition(schema(1, text=b'float64 \xff\n')), _OTHERWISE, 20, 20
    ),
    'a chunk that is older than it says': Odd(
        lambda: file(_surround_pieces(Piece(messages(20), changes={'message_start_time': START + 10**12}))),
        _ALL,
        30,
        30,
    ),
    'damaged chunk': Odd(_damaged_chunk, 'is damaged', 20, 20),
    'only chunk damaged': Odd(_all_damaged, 'nothing is known of aft_stern', 0, 0),
    'no message': Odd(lambda: file([], DEFINITIONS), 'nothing is known of aft_stern', 0, 0),
    'summary in a damaged chunk': Odd(_moved_summary, 'is damaged', 20, 20),
    'log time 0 among dates': Odd(lambda: _messages_at(0), 'have log time 0 (clock not set?)', 30, 30),
    'log time beyond 2^63': Odd(
        lambda: _messages_at(1 << 63), 'an impossible log time (2^63 ns or more)', 30, 30
    ),
    'log time 2^64 - 1': Odd(
        lambda: _messages_at((1 << 64) - 1), 'an impossible log time (2^63 ns or more)', 30, 30
    ),
    'a clock that began at 0': Odd(lambda: _messages_at(5 * 10**9), '62 messages', 31, 31),
    **{
        f'encapsulation {name}': Odd(
            lambda kind=kind: _with_encapsulation(kind),
            f"20 of 40 messages of '{SPEED}' are in the encapsulation 0x{kind:04x}",
            40,
            20,
        )
        for kind, name in ((3, 'PL_CDR_LE'), (7, 'CDR2_LE'), (0x1234, 'of no known name'))
    },
    'bound without a number': Odd(
        lambda: _with_definition(b'float64 data\nfloat64[<=] y\n'), 'which is not a field'
    ),
    'array of 5,000 digits': Odd(
        lambda: _with_definition(b'float64 data\nfloat64[' + b'9' * 5000 + b'] y\n'), 'which is not a field'
    ),
    'array of 2^32 - 1': Odd(
        lambda: _with_definition(b'float64 data\nfloat64[4294967295] y\n'),
        'cannot be decoded as std_msgs/msg/Float64',
    ),
    'a thousand beginnings': Odd(lambda: MAGIC * 2000, 'can be read: file'),
    'escapes in a name': Odd(
        lambda: file(
            [Piece([*DEFINITIONS, channel(9, '/\x1b[31m\nred\x07', 0), *messages(0, 60)])],
            (*DEFINITIONS, channel(9, '/\x1b[31m\nred\x07', 0)),
        ),
        'topic /\N{REPLACEMENT CHARACTER}[31m\N{REPLACEMENT CHARACTER}red',
        30,
        30,
    ),
}

# Those that are large, or would be without limits.
LARGE: dict[str, Odd] = {
    'definition that is too long': Odd(_long_definition, 'its definition is longer than'),
    'definitions of no concern': Odd(_many_schemas, _ALL, 30, 30),
    'zstd bomb': Odd(
        lambda: _with_chunk(_make_bomb('zstd', 1 << 30)), 'and more than 134217728 are not', 30, 30
    ),
    'zstd bomb that hides': Odd(
        lambda: _with_chunk(_make_bomb('zstd', 1 << 30, 1000)), 'it holds more bytes', 30, 30
    ),
    'zstd bomb that claims': Odd(
        lambda: _with_chunk(_make_bomb('zstd', 1 << 20, 1 << 62)), 'and more than 134217728', 30, 30
    ),
    'lz4 bomb': Odd(
        lambda: _with_chunk(_make_bomb('lz4', 200 << 20)), 'and more than 134217728 are not', 30, 30
    ),
    'lz4 bomb that hides': Odd(
        lambda: _with_chunk(_make_bomb('lz4', 200 << 20, 1000)), 'it holds more bytes', 30, 30
    ),
    'twelve schemas of 100 MiB': Odd(
        lambda: _with_chunk(b''.join(map(_long_schema, range(9, 21)))), _LIMIT, 30, 30
    ),
    'eight names of 100 MiB': Odd(
        lambda: _with_chunk(b''.join(map(_long_name, range(9, 17)))), _LIMIT, 30, 30
    ),
    'messages of equal time': Odd(
        lambda: _with_chunk(_equal_times(b'\0\1\0\0' + bytes(8)) * 4), _LIMIT, 3_000_000
    ),
    'messages without data': Odd(lambda: _with_chunk(_equal_times(b'') * 4), _LIMIT, 3_000_000),
    'messages that are too short': Odd(
        lambda: _with_chunk(_equal_times(b'\0\1\0\0\0') * 4), _LIMIT, 3_000_000
    ),
    'records of no known kind': Odd(
        lambda: _with_chunk(_grow_chunk((raw_record(0x80, b'') * 10_000, 1400)) * 4), _LIMIT, 30, 30
    ),
    'a channel redefined in 300 chunks': Odd(_redefined_often, _OTHERWISE, 30, 30),
    'ten million messages': Odd(_tiny_messages, 'and more than 134217728 are not restored', 30, 30),
    '400,000 message indexes': Odd(_many_indexes, _ALL, 30, 30),
    '40,000 channels': Odd(_many_channels, '40060 messages in 5.9 s', 30, 30),
    'one chunk 20,000 times': Odd(
        lambda: _with_chunk(Piece([message(1, START, 30.0)]).record() * 20_000),
        '20060 messages in 5.9 s',
        20_030,
        30,
    ),
}
