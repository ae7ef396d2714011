# SPDX-License-Identifier: Apache-2.0
"""What a check found as the documented JSON object; the printed text is made from it too."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from stickslip_monitor.bags.check import BearingReport, CheckReport, InputReport
from stickslip_monitor.monitor.records import event_records, number, point_record

SCHEMA = 'stickslip_monitor/check/1'


def to_json(report: CheckReport) -> dict[str, Any]:
    """The report as a JSON object."""
    bag = report.bag
    start, end = bag.start_ns, bag.end_ns
    return {
        'schema': SCHEMA,
        'path': str(bag.path),
        'start': start,
        'end': end,
        'duration': None if start is None or end is None else (end - start) * 1e-9,
        'messages': bag.message_count,
        'topics': {
            name: {'type': topic.type, 'messages': topic.count, 'problem': topic.problem or None}
            for name, topic in bag.topics.items()
        },
        'cuts': [
            {'file': str(cut.path), 'offset': cut.offset, 'size': cut.size, 'text': cut.text}
            for cut in bag.cuts
        ],
        'warnings': list(bag.warnings),
        'bearings': {name: _bearing(item) for name, item in report.bearings.items()},
    }


def error_json(path: Path, text: str) -> dict[str, Any]:
    """What stands in the place of a bag that could not be checked."""
    return {'schema': SCHEMA, 'path': str(path), 'error': text}


def _bearing(item: BearingReport) -> dict[str, Any]:
    return {
        'events': event_records(item.scan.events),
        'seconds': {regime.value: seconds for regime, seconds in item.seconds.items()},
        'worst': {
            name: {'time': extreme.time_ns, 'value': number(extreme.value)}
            | {k: v for k, v in point_record(extreme.point).items() if k in _OF_WORST[name]}
            for name, extreme in item.worst.items()
        },
        'evaluations': int(item.scan.time_ns.size),
        'data': item.complaints,
        'inputs': {each.quantity: _input(each) for each in item.inputs},
    }


_OF_WORST = {
    'hopf_margin': ('speed', 'load'),
    'fold_margin': ('speed', 'load'),
    'amplitude': ('speed', 'load', 'amplitude_exact'),
}


def _input(item: InputReport) -> dict[str, Any]:
    return {
        'topic': item.topic,
        'messages': item.messages,
        'used': item.used,
        'rate': number(item.gaps.rate),
        'gaps': item.gaps.count,
        'longest_gaps': [
            {'time': gap.start_ns, 'seconds': gap.seconds} for gap in item.gaps.longest
        ],
    }
