# SPDX-License-Identifier: Apache-2.0
"""Show what a recording or log holds: topics or columns, counts, and the time span.

No configuration is needed: use it to find the topics to configure.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from rich.text import Text

from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.table_recording import TableRecording
from stickslip_monitor.commands import options, output
from stickslip_monitor.errors import plural
from stickslip_monitor.offline.check import bag_record
from stickslip_monitor.report.summary import format_date, format_time_of_day, is_dated
from stickslip_monitor.safe_files import printable

SCHEMA = 'stickslip_monitor/info/1'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    options.add_file(parser, 'bag', metavar='BAG', help='recording or log')
    options.add_shared(parser, '--json')


def run(args: argparse.Namespace) -> int:
    """Print what a recording or log holds; return 1 if no time is usable or nothing could be read, else 0.

    No time is usable where no message has one, or all have the same: a clock that was not set is 0.

    Raises:
        BagError: It cannot be opened.
    """
    bag = open_bag(args.bag)
    record = bag_record(bag)
    has_lines = any(topic.count > 1 for topic in bag.topics.values())
    problem = 'no line has a time that can be read' if record['start'] is None and record['messages'] else ''
    if record['duration'] == 0.0 and has_lines:
        problem = f'all times are the same, {record["start"]} ns: was the clock of the recorder not set?'
    if record['end'] is not None and is_dated(record['end']) and not is_dated(record['start']):
        problem = (
            f'times begin at {format_time_of_day(record["start"])} and end on {format_date(record["end"])}:'
            ' was the clock of the recorder set meanwhile?'
        )
    # Lines without a time are no recording, nor is one of which nothing could be read.
    code = int(bool(problem or (record['start'] is None and bag.losses)))
    if args.json:
        output.print_json({'schema': SCHEMA, **record})
        return code
    out = output.console()
    out.print(printable(_summary_clause(record)), markup=False)
    values = isinstance(bag, TableRecording) and {name: topic.value for name, topic in bag.topics.items()}
    table = output.make_table('', f'topic; type; messages; {"value" if values else "problem"}', (0, 1, 3))
    # Columns stand as in the file.
    topics = record['topics'].items() if values else sorted(record['topics'].items())
    for name, topic in topics:
        last = values[name] if values else topic['problem'] or ''
        texts = name, topic['type'], str(topic['messages']), last
        # A heading may have brackets, which are no markup.
        table.add_row(*(Text(printable(text)) for text in texts))
    if topics:
        out.print(table)
    for text in (*(cut['text'] for cut in record['cuts']), *record['warnings']):
        out.print(printable(f'data: {text}'), markup=False)
    if problem:
        out.print(f'data: {problem}', markup=False)
    return code


def _summary_clause(record: Mapping[str, Any]) -> str:
    """Return a clause on a recording: its path, how many messages there are, and from when to when."""
    text = f'{record["path"]}: {plural(record["messages"], "message")}'
    if record['duration'] is None:
        return text
    text += f' in {record["duration"]:.1f} s'
    if not is_dated(record['start']):
        return f'{text}, on a clock without dates'
    start, end = (
        f'{format_date(time)} {format_time_of_day(time)}' for time in (record['start'], record['end'])
    )
    return f'{text}, from {start} to {end} UTC'
