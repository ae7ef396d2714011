# SPDX-License-Identifier: Apache-2.0
"""Mutants of recordings: bytes, records, and records inside chunks whose checksums are mended."""

from __future__ import annotations

import random
import struct
import zlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from io import BytesIO

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.records import Chunk

from fuzz.files import HEAD, MAGIC, compressed, encode_record
from fuzz.logs import change_cell, change_delta, change_sentence, change_value
from fuzz.rewriting import rewrite

_NUMBERS = (0, 1, 2, 7, 0x7F, 0xFF, 1 << 16, (1 << 31) - 1, 1 << 32, 1 << 40, 1 << 63, (1 << 64) - 1)
_OPCODES = (*range(16), 0x80, 0xFF)
Records = list[bytes]


def mutant(seed: int, sources: Sequence[bytes], kind: str = 'mcap') -> bytes:
    """Return a mutant; it is the same for the same seed and sources of a kind."""
    rng = random.Random(seed)
    data = rng.choice(sources)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        data = rng.choice(_WAYS[kind])(rng, data, sources)
    return data


def records_of(data: bytes, start: int = 0) -> Records:
    """Split data into its records; what is left is the last one."""
    records, offset = [], start
    while offset + HEAD.size <= len(data):
        end = offset + HEAD.size + HEAD.unpack_from(data, offset)[1]
        if end > len(data):
            break
        records.append(data[offset:end])
        offset = end
    return [*records, data[offset:]]


def _flip_bits(rng: random.Random, data: bytes, _: Sequence[bytes]) -> bytes:
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 3, 10))):
        if out:
            out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
    return bytes(out)


def _overwrite_part(rng: random.Random, data: bytes, _: Sequence[bytes]) -> bytes:
    begin = rng.randrange(len(data) + 1)
    size = rng.choice((1, 8, 40, 400))
    new = rng.choice((bytes(size), b'\xff' * size, rng.randbytes(size), MAGIC))
    return data[:begin] + new + data[begin + len(new) :]


def _lose_blocks(rng: random.Random, data: bytes, _: Sequence[bytes]) -> bytes:
    """Return data with zeros in place of whole blocks of a disk, as a power cut leaves them."""
    size = rng.choice((512, 512, 512, 4096))
    begin = rng.randrange(len(data) // size + 1) * size
    end = rng.choice((begin + size, begin + 2 * size, len(data)))
    return data[:begin] + bytes(len(data[begin:end])) + data[end:]


def _cut_part(rng: random.Random, data: bytes, _: Sequence[bytes]) -> bytes:
    begin, end = sorted(rng.randrange(len(data) + 1) for _ in range(2))
    return rng.choice((data[:begin], data[:begin] + data[end:], data[:end] + data[begin:]))


def _join_sources(rng: random.Random, data: bytes, sources: Sequence[bytes]) -> bytes:
    source = rng.choice(sources)
    return data[: rng.randrange(len(data) + 1)] + source if rng.random() < 0.5 else data + source


def _change_records(rng: random.Random, data: bytes, _: Sequence[bytes]) -> bytes:
    return data[: len(MAGIC)] + b''.join(_change_one_record(rng, records_of(data, len(MAGIC))))


def _change_chunk(rng: random.Random, data: bytes, _: Sequence[bytes]) -> bytes:
    """Change records inside a chunk and mend what the chunk says of itself."""
    records = records_of(data, len(MAGIC))
    chunks = [k for k, record in enumerate(records) if record[:1] == b'\6']
    if not chunks:
        return data
    k = rng.choice(chunks)
    try:
        chunk = Chunk.read(ReadDataStream(BytesIO(records[k][HEAD.size :])))
        plain = _decompress_chunk(chunk)
    except Exception:  # A mutant of a mutant may be anything.
        return data
    plain = b''.join(_change_one_record(rng, records_of(plain)))
    crc = zlib.crc32(plain) if rng.random() < 0.5 else 0
    body = compressed(plain, chunk.compression)
    records[k] = encode_record(replace(chunk, data=body, uncompressed_crc=crc, uncompressed_size=len(plain)))
    return data[: len(MAGIC)] + b''.join(records)


def _decompress_chunk(chunk: Chunk) -> bytes:
    if chunk.compression == 'zstd':
        return zstandard.decompress(chunk.data, max_output_size=1 << 20)
    return bytes(lz4.frame.decompress(chunk.data)) if chunk.compression else chunk.data


def _change_one_record(rng: random.Random, records: Records) -> Records:
    """Return records with one of them changed, dropped, repeated, moved or swapped."""
    records = list(records)
    i, j = rng.randrange(len(records)), rng.randrange(len(records))
    match rng.randrange(7):
        case 0:
            del records[i]
        case 1:
            records.insert(j, records[i])
        case 2:
            records[i], records[j] = records[j], records[i]
        case 3:
            records[i] = bytes([rng.choice(_OPCODES)]) + records[i][1:]
        case 4:
            length = rng.choice((*_NUMBERS, len(records[i]) - 10, len(records[i]) - 8))
            records[i] = records[i][:1] + struct.pack('<Q', length % (1 << 64)) + records[i][9:]
        case 5:
            records[i] = _with_number(rng, records[i])
        case _:
            records[i] = records[i][:9] + _flip_bits(rng, records[i][9:], ())
    return records


def _with_number(rng: random.Random, record: bytes) -> bytes:
    """Set one field of a record to an odd number; in a message a channel or a time, by preference."""
    places = ((9, '<H'), (15, '<Q'), (23, '<Q')) if record[:1] == b'\5' else ()
    place, code = rng.choice(places) if places else (9 + rng.randrange(60), rng.choice(('<I', '<Q')))
    size = struct.calcsize(code)
    if len(record) < place + size:
        return record
    number = rng.choice(_NUMBERS) % (1 << 8 * size)
    return record[:place] + struct.pack(code, number) + record[place + size :]


_Way = Callable[[random.Random, bytes, Sequence[bytes]], bytes]
_BYTES: tuple[_Way, ...] = (_flip_bits, _overwrite_part, _lose_blocks, _cut_part, _join_sources)
_WAYS: dict[str, tuple[_Way, ...]] = {
    'mcap': (*_BYTES, _change_records, _change_records, _change_chunk, _change_chunk, _change_chunk),
    'csv': (*_BYTES, *[change_cell] * 6, *[rewrite] * 10),
    'db3': (*_BYTES, *[change_value] * 6),
    'parquet': _BYTES,
    'nmea': (*_BYTES, *[change_sentence] * 6, *[rewrite] * 10),
    'signalk': (*_BYTES, *[change_delta] * 6, *[rewrite] * 10),
    'canboat': (*_BYTES, *[change_delta] * 6, *[rewrite] * 10),
    'candump': (*_BYTES, *[rewrite] * 10),
    'packed': (*_BYTES, *[rewrite] * 5),
}
