# SPDX-License-Identifier: Apache-2.0
"""Changes of texts as loggers, exports and people make them: of one line, of a run of lines, or of all.

A text that is packed is unpacked first, and packed again.
"""

from __future__ import annotations

import bz2
import functools
import gzip
import lzma
import operator
import random
import re
import zlib
from collections.abc import Callable, Sequence

import zstandard

_SENTENCE = re.compile(r'([$!])([^*$!\r\n]*)\*[0-9A-Fa-f]{2}')
_PACKINGS: tuple[tuple[bytes, Callable[[], Callable[[bytes], bytes]], Callable[[bytes], bytes]], ...] = (
    (b'\x1f\x8b', lambda: zlib.decompressobj(31).decompress, lambda data: gzip.compress(data, mtime=0)),
    (
        b'\x28\xb5\x2f\xfd',
        lambda: zstandard.ZstdDecompressor().decompressobj().decompress,
        zstandard.compress,
    ),
    (b'BZh', lambda: bz2.BZ2Decompressor().decompress, bz2.compress),
    (b'\xfd7zXZ', lambda: lzma.LZMADecompressor().decompress, lzma.compress),
)
_ODD = ('-999', '-9999.0', '65535', '3276.7', '0', '', 'NaN', 'null', '#N/A', '---', '1e2', '6,0', '6.0 rpm')
_LOCALES = (',.', ';,'), (';,', ',.')
# What is looked for in each line, and what may stand in its place.
_PATTERNS: tuple[tuple[str, tuple[str, ...]], ...] = (
    (r',', (';', '\t', ', ', ',,', '.')),
    (r';', (',', '\t', '; ')),
    (r'\.(?=\d)', (',', '', '. ')),
    (r'(?<=\d)Z', ('', '+02:00', '-0100', ' UTC', 'z')),
    (r'(?<=\d)T(?=\d)', (' ', '_', ',', 't')),
    (
        r'(\d{4})-(\d\d)-(\d\d)',
        (r'\3.\2.\1', r'\3/\2/\1', r'\2/\3/\1', '', r'\3-\2-\1', r'\1\2\3', '1970-01-01'),
    ),
    (r'(\d\d:\d\d):\d\d', (r'\1', r'\1:60', r'\1:00')),
    (r'T06:', ('T05:', 'T07:', 'T18:', 'T30:')),
    (r'2026', ('2025', '2027', '1926', '26')),
    (r'\b\d+\.\d{3}\b', _ODD),
    (r'1000\.0', _ODD),
    (r'rpm', ('Hz', 'RPM', '', '1/min', 'kn', 'x10 rpm', '%')),
    (r'\[N\]|,N\b', (',kN', '[kN]', ',', '[t]', ',B', '[%]')),
    (r'speed', ('load', 'Speed', 'speed ', 'speed 2')),
    (r'ER', ('II', 'VD', 'er')),
    (r'n2k\.1', ('n2k.2', '')),
    (r'RPM,S,1', ('RPM,E,1', 'RPM,S,2', 'RPM,S,01', 'RPM,S,0', 'RPM,P,1')),
    (r'10\.5,A', ('10.5,V', 'A', ',A', '10.5,', '10.5')),
    (r'bearing load', ('BEARING LOAD', 'bearing load 2', '')),
    (r'vessels\.self', ('vessels.urn:mrn:imo:mmsi:257000000', 'vessels.urn:mrn:imo:mmsi:1', '', 'self')),
    (r'propulsion\.0', ('propulsion.1', 'propulsion.port', 'Propulsion.0')),
    (r'"Instance": 0', ('"Instance": 1', '"Instance": "Single Engine or Dual Engine Port"', '"I": 0')),
    (r'"src": 16', ('"src": 17', '"src": "16"')),
    (r'127488', ('127489', '"127488"')),
    (r'(: )(\d+\.\d+)', (r'\1"\2"', r'\1{"value": \2}', r'\1null', r'\1[\2]', r'\1\2e0', r'\1NaN')),
    (r'^', ('\x02', '#', ' ', '\ufeff', '"', '\0', '1;', 'INFO ', '2026-05-04T06:00:00Z ', '> ', '\xb6')),
    (r'$', (',', ';', ' ', '\x03', '\r', ',,,', ',0', '"', ' #', ',x', '\n', '}', '*00', '\xc3')),
    (r'^(.*)$', (r'"\1"', r'\1\1', r'\1,\1', '', '# \\1', r'\1 \1')),
    (r'^([^,;]*)[,;]([^,;]*)', (r'\2,\1', r'\1,1,\2', r'\1', r'\2')),
    (r'(\d)(\d)', (r'\2\1', r'\1', r'\1\2\2')),
    (r'[A-Za-z]', ('', 'x')),
)


def unpack_text(data: bytes) -> tuple[bytes, Callable[[bytes], bytes]]:
    """Return a text, of a damaged packed one as much as can be unpacked, and what packs it again."""
    for magic, make, pack in _PACKINGS:
        if data.startswith(magic):
            feed, parts = make(), list[bytes]()
            try:
                for k in range(0, len(data), 64):
                    parts.append(feed(data[k : k + 64]))
            except Exception:  # Of a damaged one the rest is lost.
                pass
            return b''.join(parts), pack
    return data, bytes


def pack_in_all_ways(text: bytes) -> list[bytes]:
    """Return a text packed in each way."""
    return [pack(text) for _, _, pack in _PACKINGS]


def rewrite(rng: random.Random, data: bytes, _: Sequence[bytes]) -> bytes:
    """Return a text with some of its lines rewritten, moved, repeated or dropped."""
    plain, pack = unpack_text(data)
    encoding = 'utf-16' if plain[:2] == b'\xff\xfe' else 'latin-1'
    lines = plain.decode(encoding, 'replace').split('\n')
    begin, end = sorted(rng.randrange(len(lines) + 1) for _ in range(2))
    begin, end = rng.choice(
        ((begin, end), (begin, end), (begin, len(lines)), (0, len(lines)), (0, 1), (begin, begin + 1))
    )
    run = lines[begin:end]
    run = _rewrite_lines(rng, run) if rng.random() < 0.7 else _move_lines(rng, run, lines)
    text = '\n'.join([*lines[:begin], *run, *lines[end:]])
    return pack(text.encode(encoding, 'replace'))


def _rewrite_lines(rng: random.Random, lines: list[str]) -> list[str]:
    """Return lines with the matches of a pattern replaced, in each the first or all; checksums are mended."""
    text = '\n'.join(lines)
    candidates = [(pattern, new) for pattern, new in _PATTERNS if re.search(pattern, text, re.M)]
    if not candidates:
        return lines
    pattern, news = rng.choice(candidates)
    new, count = rng.choice(news), rng.choice((0, 1, 1))
    share = rng.choice((1.0, 1.0, 0.5))
    rewritten = [re.sub(pattern, new, line, count=count) if rng.random() < share else line for line in lines]
    return [_mend_checksums(line) for line in rewritten] if rng.random() < 0.9 else rewritten


def _mend_checksums(line: str) -> str:
    """Return a line with the right checksums of sentences of NMEA 0183."""

    def sentence(match: re.Match[str]) -> str:
        total = functools.reduce(operator.xor, match[2].encode('latin-1', 'replace'), 0)
        return f'{match[1]}{match[2]}*{total:02X}'

    return _SENTENCE.sub(sentence, line)


def _move_lines(rng: random.Random, run: list[str], lines: list[str]) -> list[str]:
    """Return a run of lines in another order, with others between them, or without some."""
    place = rng.randrange(len(run) + 1)
    match rng.randrange(15):
        case 0:
            return run[::-1]
        case 1:
            return rng.sample(run, len(run))
        case 2:
            return run[place:] + run[:place]
        case 3:
            return run + run
        case 4:
            return [line for line in run for _ in range(2)]
        case 5:
            return []
        case 6:
            return run[:: rng.choice((2, 3, 7))]
        case 7:
            return [*run[:place], lines[0], *run[place:]]
        case 8:
            return [
                *run[:place],
                rng.choice(('', '# restarted', 'Error 17', '-' * 40, 'a,b,c,d', '$GPGGA,1,2*00')),
                *run[place:],
            ]
        case 9:
            return (
                [''.join(run)]
                if len(run) < 4
                else [*run[:place], ''.join(run[place : place + 2]), *run[place + 2 :]]
            )
        case 10:
            inserted = lines[: len(run)]
            return [line for pair in zip(run, inserted, strict=False) for line in pair]
        case 11:
            return [*run[:place], *run[place : place + 2][::-1], *run[place + 2 :]]
        case 12:
            return [re.sub(r'[,;\t][^,;\t]*$', '', line) if rng.random() < 0.5 else line for line in run]
        case 13:
            locale = str.maketrans(*rng.choice(_LOCALES))
            return [line.translate(locale) for line in run]
        case _:
            # A frozen clock, or a frozen value: what the first line of the run begins or ends with.
            size = len(run[0]) // 2 if run else 0
            keeps_head = rng.random() < 0.5
            return [
                _mend_checksums(run[0][:size] + line[size:] if keeps_head else line[:size] + run[0][size:])
                for line in run
            ]
