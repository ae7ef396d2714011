# SPDX-License-Identifier: Apache-2.0
"""Containers written by the column, beside the writer of the ``mcap`` package."""

from __future__ import annotations

import io

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer

from stickslip_logs.recordings.chunk_writer import ChunkWriter, Messages

Column = tuple[int, np.ndarray, Messages]


@pytest.mark.parametrize('seed', range(30))
def test_the_bytes_are_those_of_the_writer_of_messages_one_by_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    size, compression = int(rng.choice([0, 50, 400, 3000, 1 << 20])), ['none', 'lz4', 'zstd'][seed % 3]
    files = io.BytesIO(), io.BytesIO()
    one_by_one = Writer(files[0], size, CompressionType[compression.upper()])
    writer = ChunkWriter(files[1], size, compression)
    for chunk_writer in (one_by_one, writer):
        chunk_writer.start('ros2', 'library')
    if seed % 2:
        one_by_one.add_metadata('label', {})
        writer.add_metadata('label')
    channels, counts = list[int](), dict[int, int]()
    for block in range(rng.integers(1, 5)):
        for _ in range(rng.integers(0, 3)):
            topic, text = f'/{len(channels)}', b'float64 data\n' * block
            schema = writer.add_schema(topic, 'ros2msg', text)
            assert one_by_one.register_schema(topic, 'ros2msg', text) == schema
            channels.append(writer.add_channel(topic, 'cdr', schema, {'key': 'value'}))
            assert one_by_one.register_channel(topic, 'cdr', schema, {'key': 'value'}) == channels[-1]
        columns = [make_column(rng, channel) for channel in channels if rng.random() < 0.7]
        rows = [
            (t, channel, m)
            for channel, time, data in columns
            for t, m in zip(time.tolist(), data, strict=True)
        ]
        for time, channel, message in sorted(rows, key=lambda row: row[0]):
            one_by_one.add_message(channel, time, bytes(message), time, counts.get(channel, 0))
            counts[channel] = counts.get(channel, 0) + 1
        if columns:
            writer.write(columns)
    one_by_one.finish()
    writer.finish()
    assert files[1].getvalue() == files[0].getvalue()
    assert writer.counts == counts


def make_column(rng: np.random.Generator, channel: int) -> Column:
    """Messages of some sizes, or of one, at times of which some are equal and some go back."""
    time = rng.integers(0, 60, rng.integers(1, 40))
    if rng.random() < 0.5:
        return channel, time, np.frombuffer(rng.bytes(12 * time.size), 'V12')
    return channel, time, [rng.bytes(int(rng.integers(0, 6))) for _ in range(time.size)]
