# SPDX-License-Identifier: Apache-2.0
"""Run the monitor over recorded bags: events, time in each regime, worst margins, bad data.

A bag is a rosbag2 folder or an .mcap file; a folder of bags stands for all of them, and - for
MCAP on standard input. A truncated bag is read up to the cut. --report writes one file that opens
anywhere without a network: .html to read, .png to show, .json for programs. --mcap writes the
verdicts as messages beside the inputs, for replay in Foxglove or PlotJuggler; --clips writes a
short recording around each alarm.
Several bags are checked on all cores, or with --scheduler on a Dask cluster whose workers see
them under the same paths. A bad bag is named and does not stop the rest.
--learn compares when a bearing vibrated with what was predicted, over all bags, and proposes a
calibration if it would change something; this advice changes neither the configuration nor the
exit code. Exits 0 if all was read and nothing warned, 1 if something did or a part could not be
read, 2 if a bag could not be checked or has no usable data.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_monitor.commands import options, output
from stickslip_monitor.errors import ConfigurationError, plural
from stickslip_monitor.files import PICTURES, printable
from stickslip_monitor.monitor.ladder import Level

if TYPE_CHECKING:
    from stickslip_monitor.commands.check_tasks import Found
    from stickslip_monitor.offline.clips import ClipCounts

STDIN = '-'
REPORTS = {
    '.html': b'<meta name="generator" content="stickslip_monitor">',
    '.png': PICTURES['.png'],
    '.json': b'"schema": "stickslip_monitor/check/1"',
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    text = 'rosbag2 folder, .mcap file, folder of these, or - for standard input'
    options.add_input(parser, 'bags', nargs='+', metavar='BAG', help=text)
    options.add_config(parser)
    options.add_bearing(parser)
    options.add_force(parser)
    options.add_json(parser)
    text = 'write a report: .html, .png or .json (needs matplotlib)'
    options.add_output(parser, '--report', '-o', marks=REPORTS, help=text)
    text = "write inputs and verdicts as the node's topics: .mcap"
    options.add_recording(parser, '--mcap', is_folder=False, metavar='FILE', help=text)
    text = 'write a clip of each alarm into this folder'
    options.add_recording(parser, '--clips', is_folder=True, metavar='DIR', help=text)
    text = (
        "propose a calibration from the configured 'level', an operator's reports (a CSV file),"
        " or the 'truth' of simulated bags"
    )
    options.add_input(parser, '--learn', metavar='FROM', help=text)
    text = 'bags checked at a time (default: one for each core)'
    options.add_number(parser, '--jobs', 1, metavar='N', help=text)
    options.add_gone(parser, '--resume', 'keep the --json of each recording in a file of its own')
    text = "check on the workers of a Dask cluster: tcp://host:port (extra 'fleet')"
    parser.add_argument('--scheduler', metavar='ADDRESS', help=text)


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    _check_options(args)
    # Not needed for help or a wrong option, and it takes most of the time to start.
    from stickslip_monitor.bags.reader import find_bags, spooled

    with output.ProgressBar() as meter:
        if STDIN not in args.bags:
            return _check_bags(args, find_bags(args.bags), meter)
        with spooled(sys.stdin.buffer, meter.show) as path:
            args.bags = [str(path)]
            return _check_bags(args, [path], meter, STDIN)


def _check_options(args: argparse.Namespace) -> None:
    if STDIN in args.bags and (len(args.bags) > 1 or args.scheduler):
        raise ConfigurationError(
            "'-', a recording on standard input, goes alone: neither with other bags nor with --scheduler"
        )
    if args.scheduler is None:
        return
    for option in ('jobs', 'mcap', 'clips'):
        if getattr(args, option) is not None:
            raise ConfigurationError(
                f'--{option} does not go with --scheduler: it is for bags checked on this machine'
            )


def _check_bags(
    args: argparse.Namespace, bags: Sequence[Path], meter: output.ProgressBar, shown: str | None = None
) -> int:
    """Check bags, and print and write what came of them in the order in which they are asked for.

    Args:
        args: What is to be printed and written.
        bags: The recordings.
        meter: Shows how far the work is.
        shown: What the only bag is called, where its path means nothing to anybody.

    Returns:
        The exit code: 1 after a warning, 2 after a bag that could not be checked.
    """
    from stickslip_monitor.commands import check_tasks

    task = check_tasks.task_of(args, len(bags))
    # A folder's bags are a list, even where it holds one only.
    listed = len(bags) > 1 or bags != [Path(path) for path in args.bags]
    all_found = []
    archive = check_tasks.archive_of(task)
    for found in check_tasks.check_all(task, bags, args, meter):
        _tell(found, args, listed, shown)
        if archive is not None and found.part is not None:
            archive.add(found.part)
        all_found.append(replace(found, part=None))
    documents = [found.document for found in all_found]
    code = max(found.code for found in all_found)
    if not listed and 'error' in documents[0]:
        return code
    if task.learn is not None:
        lessons = check_tasks.lessons_of(args, task, all_found, meter)
        for document in documents:
            # All teach it.
            document['learned'] = lessons
        if not args.json:
            sys.stdout.writelines(f'learned: {printable(text)}\n' for text in lessons)
    text = output.json_text(documents if listed else documents[0])
    output.write_outputs(args, report=lambda: check_tasks.report_of(args, task, archive, text))
    if args.mcap is not None:
        output.say_written(args.mcap)
    advice = check_tasks.tolerance_advice(task.config)
    if args.json:
        sys.stdout.write(text)
    elif advice:
        sys.stdout.write(f'{_wrapped(advice, output.line_width())}\n')
    return code


def _tell(found: Found, args: argparse.Namespace, listed: bool, shown: str | None) -> None:
    """Print what came of one bag."""
    document, error = found.document, found.document.get('error')
    if shown is not None:
        error = error and error.replace(document['path'], shown)
        document['path'] = shown
    place = printable(document['path'])
    if error:
        document['error'] = error
        where = f'{place}: ' if listed else ''
        sys.stderr.write(f'ERROR: {where}{printable(error)}\n')
        if args.json and not listed:
            output.print_json(document)
    elif not args.json:
        coloured = sys.stdout.isatty() and 'NO_COLOR' not in os.environ
        sys.stdout.write(to_text(document, coloured, output.line_width()))
        sys.stdout.flush()
    for name in found.unjudged:
        sys.stderr.write(f'ERROR: {place}: nothing is known of {name}: no message gave an operating point\n')
    if found.clips is not None:
        _tell_clips(found.clips, place, printable(args.clips))


def _tell_clips(clips: ClipCounts, place: str, folder: str) -> None:
    written = f'{plural(clips.written, "clip")} written into {folder}'
    if clips.removed:
        written += f'; {plural(clips.removed, "older clip")} removed, as clips.most says'
    sys.stderr.write(f'{place}: {written}\n')
    for text in clips.failures:
        sys.stderr.write(f'ERROR: {place}: a clip was not written: {printable(text)}\n')


_GREEN, _YELLOW, _RED, _BOLD, _END = (f'\x1b[{code}m' for code in (32, 33, 31, 1, 0))
_CODE = re.compile('\x1b\\[\\d+m')
_OF_LEVEL = {Level.OK.name: _GREEN, Level.WARN.name: _YELLOW, Level.ERROR.name: _RED}
_WORST = {'hopf_margin': 'Hopf margin', 'fold_margin': 'fold margin', 'amplitude': 'amplitude'}
# On a narrower screen an event is a block of lines, not one.
_NARROW = 90


def to_text(document: Mapping[str, Any], coloured: bool, width: int | None = None) -> str:
    """The text of one bag.

    Args:
        document: What ``check --json`` prints of it.
        coloured: Whether it goes to a terminal that knows colours.
        width: Letters on a line; any number if None.
    """
    lines = _lines(document, width)
    if not coloured:
        lines = (_CODE.sub('', line) for line in lines)
    # Those of events, which are indented, are broken as a table.
    return ''.join(f'{line if line.startswith(" ") else _wrapped(line, width)}\n' for line in lines)


def _painted(colour: str, text: str) -> str:
    return f'{colour}{text}{_END}'


def _wrapped(line: str, width: int | None, indent: int = 2) -> str:
    """A line, broken at a number of letters; whole if that is None."""
    if width is None:
        return line
    # The last column stays free: not every terminal breaks behind it.
    # A path that is cut in two cannot be copied.
    return textwrap.fill(
        line,
        max(width - 1, 20),
        subsequent_indent=' ' * indent,
        break_long_words=False,
        break_on_hyphens=False,
    )


def _lines(document: Mapping[str, Any], width: int | None) -> Iterator[str]:
    seconds = document['duration'] or 0.0
    path = _painted(_BOLD, printable(document['path']))
    yield f'{path}: {plural(document["messages"], "message")} in {seconds:.1f} s'
    faults = [*(cut['text'] for cut in document['cuts']), *document['warnings']]
    faults += (
        f'topic {name} not readable: {topic["problem"]}'
        for name, topic in document['topics'].items()
        if topic['problem']
    )
    for text in faults:
        yield f'{_painted(_YELLOW, "data:")} {printable(text)}'
    for name, item in document['bearings'].items():
        yield from _bearing_lines(name, item, document['start'] or 0, width)


def _bearing_lines(name: str, item: Mapping[str, Any], start: int, width: int | None) -> Iterator[str]:
    for text in item['data']:
        yield f'{_painted(_YELLOW, "data:")} {printable(text)}'
    for quantity, each in item['inputs'].items():
        place = printable(quantity if 'assumed' in each else f'{quantity} on {each["topic"]}')
        yield f'{place}: {_input_text(quantity, each)}'
        for text in each['questions']:
            yield f'{_painted(_YELLOW, "question:")} {place} {printable(text)}'
    events = item['events']
    yield f'{name}: {plural(len(events), "event") if events else "no events"}'
    if events and (width is None or width >= _NARROW):
        yield _painted(_BOLD, f'  {"time [s]":>10}  {"from":<15}  {"to":<15}  what')
    for event in events:
        text = printable(event['text'].removeprefix(f'{name}: '))
        yield from _event_lines(event, text, start, width)
    for title, spent in (('time in each regime', 'seconds'), ('measured vibration', 'measured')):
        if spent in item:
            times = (f'{state} {seconds:.1f} s' for state, seconds in item[spent].items())
            yield f'{title}: {", ".join(times)}'
    for quantity, called in _WORST.items():
        if quantity in item['worst']:
            extreme = item['worst'][quantity]
            value, seconds = extreme['value'], (extreme['time'] - start) * 1e-9
            shown = f'{value * 1e3:.4g} mm' if quantity == 'amplitude' else f'{value:+.1%}'
            yield f'worst {called}: {shown} at {seconds:.2f} s'


def _event_lines(event: Mapping[str, Any], text: str, start: int, width: int | None) -> Iterator[str]:
    seconds, to, colour = (event['time'] - start) * 1e-9, event['to'], _OF_LEVEL[event['level']]
    if width is not None and width < _NARROW:
        change = _wrapped(f'  {seconds:.2f} s: {event["from"]} to {to}', width, 4)
        yield f'{change.removesuffix(to)}{_painted(colour, to)}'
        yield _wrapped(f'    {text}', width, 4)
    else:
        # Of the finished line, as colours take room in a text but none on the screen.
        head = f'  {seconds:>10.2f}  {event["from"]:<15}  {to:<15}  '
        line = _wrapped(f'{head}{text}', width, len(head))
        yield line.replace(head, f'{head[:-17]}{_painted(colour, head[-17:-2])}  ', 1)


def _input_text(quantity: str, item: Mapping[str, Any]) -> str:
    """What came of an input: the range of its numbers, its rate, and the share used."""
    if 'assumed' in item:
        return f'{item["si_span"][0]:.4g} N, assumed: nothing measures it'
    if not item['used']:
        return f'{plural(item["messages"], "message")}, none used'
    (low, high), (si_low, si_high) = item['span'], item['si_span']
    unit = 'm/s' if quantity == 'speed' else 'N'
    si = '' if quantity == 'level' else f' ({si_low:.4g} to {si_high:.4g} {unit})'
    rate = '' if item['rate'] is None else f', {item["rate"]:.3g} a second'
    return f'{low:.4g} to {high:.4g} in the messages{si}{rate}, {item["share"]:.1%} used'
