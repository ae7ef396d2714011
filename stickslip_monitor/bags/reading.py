# SPDX-License-Identifier: Apache-2.0
"""One pass over a recording for the numbers that were asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from stickslip_monitor.monitor.fields import FieldPath

from .ahead import load_ahead
from .blocks import Block, DamagedBlock
from .columns import Order, Ranked, Strand, make_table, take_block
from .plan import Plan
from .scan import FileScan
from .topics import make_plan
from .values import Fault, Request, Series

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Wanted:
    """The numbers wanted of one topic, with the requests for each of them."""

    topic: str
    type: str
    requests: Mapping[FieldPath, Sequence[Request]]


# The strands of a file by channel, each with its number among the strands of all files.
_FileStrands = dict[int, tuple[int, Strand]]


def read_series(
    files: Sequence[FileScan],
    topics: Sequence[Wanted],
    damaged: Callable[[str], None],
    progress: Progress | None,
) -> dict[Request, Series]:
    """Read numbers of some topics.

    Args:
        files: The files of the recording in order.
        topics: What is wanted.
        damaged: Told the sentence of each block that is damaged.
        progress: Told the bytes done and the bytes to do after each block.

    Returns:
        A series for each request.

    Raises:
        BagError: A path does not lead to a number, or a file cannot be read.
    """
    strands = _make_strands(files, topics)
    order = Order()
    jobs = list(_jobs(files, strands))
    total, done = sum(block.length for block, _ in jobs), 0
    for (block, members), loaded in zip(
        jobs, load_ahead([block for block, _ in jobs]), strict=True
    ):
        if isinstance(loaded, DamagedBlock):
            damaged(str(loaded))
        else:
            take_block(loaded, members, order)
        done += block.length
        if progress is not None:
            progress(done, total)
    return _all_series(topics, files, strands, order)


def _make_strands(files: Sequence[FileScan], topics: Sequence[Wanted]) -> list[_FileStrands]:
    wanted = {topic.topic: topic for topic in topics}
    plans: dict[tuple[str, str, bytes], Plan] = {}
    strands: list[_FileStrands] = []
    number = 0
    for file in files:
        strands.append({})
        for channel in file.channels.values():
            if channel.topic in wanted:
                schema = file.schemas[channel.schema_id]
                key = (channel.topic, schema.name, schema.data)
                if key not in plans:
                    paths = tuple(wanted[channel.topic].requests)
                    plans[key] = make_plan(channel.topic, schema, paths)
                strands[-1][channel.id] = (number, Strand(plans[key]))
                number += 1
    return strands


def _jobs(
    files: Sequence[FileScan], strands: Sequence[_FileStrands]
) -> Iterator[tuple[Block, _FileStrands]]:
    """Pair each block with the strands of its file, without those that have nothing wanted."""
    for file, members in zip(files, strands, strict=True):
        for block in file.blocks:
            if members and (not block.index or block.index.keys() & members.keys()):
                yield block, members


def _all_series(
    topics: Sequence[Wanted],
    files: Sequence[FileScan],
    strands: Sequence[_FileStrands],
    order: Order,
) -> dict[Request, Series]:
    ranked = order.ranked(sum(map(len, strands)))
    result: dict[Request, Series] = {}
    for topic in topics:
        mine = [
            member
            for file, members in zip(files, strands, strict=True)
            for channel, member in members.items()
            if file.channels[channel].topic == topic.topic
        ]
        result.update(_topic_series(topic, mine, ranked))
    return result


def _topic_series(
    topic: Wanted, members: Sequence[tuple[int, Strand]], ranked: Sequence[Ranked]
) -> Iterator[tuple[Request, Series]]:
    strands = [strand for _, strand in members]
    table = make_table(strands, [ranked[number] for number, _ in members], len(topic.requests))
    for row, requests in enumerate(topic.requests.values()):
        counts = (
            (sum(strand.undecoded for strand in strands), f'cannot be decoded as {topic.type}'),
            (
                sum(strand.short[row] for strand in strands),
                f"have too few elements for field '{requests[0].field}'",
            ),
        )
        faults = tuple(
            Fault(count, f"{count} of {len(table.sequence)} messages of '{topic.topic}' {reason}")
            for count, reason in counts
            if count
        )
        for request in requests:
            yield (
                request,
                Series(
                    table.log_time_ns, table.stamp_ns, table.sequence, table.values[row], faults
                ),
            )
