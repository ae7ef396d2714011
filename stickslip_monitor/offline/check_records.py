# SPDX-License-Identifier: Apache-2.0
"""What a check finds of a recording as one record, from which JSON, text and report are made."""

from __future__ import annotations

from typing import Any

from stickslip_monitor.bags.recording import Recording
from stickslip_monitor.monitor.messages import event_record, number
from stickslip_monitor.offline.check import BearingReport, CheckReport
from stickslip_monitor.offline.input_report import InputReport

SCHEMA = 'stickslip_monitor/check/2'


def to_json(report: CheckReport) -> dict[str, Any]:
    """The report as a JSON object."""
    return {
        'schema': SCHEMA,
        **bag_record(report.bag),
        'complete': report.complete,
        'bearings': {name: _bearing_record(item) for name, item in report.bearings.items()},
    }


def bag_record(bag: Recording) -> dict[str, Any]:
    """What a recording holds, whatever it is checked for."""
    start, end = bag.start_ns, bag.end_ns
    return {
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
    }


def _bearing_record(item: BearingReport) -> dict[str, Any]:
    return {
        'events': [event_record(event) for event in item.events],
        'seconds': {regime.value: seconds for regime, seconds in item.seconds.items()},
        'worst': {
            name: {'time': extreme.time_ns, 'value': number(extreme.value)}
            | {
                k: number(getattr(extreme.point, k))
                for k in ('speed', 'load', 'amplitude_exact')
                if k != 'amplitude_exact' or name == 'amplitude'
            }
            for name, extreme in item.worst.items()
        },
        **({} if item.measured is None else {'measured': item.measured}),
        'evaluations': item.evaluations,
        'data': item.complaints,
        'inputs': {each.quantity: _input(each) for each in item.inputs},
    }


def _input(item: InputReport) -> dict[str, Any]:
    return {
        'topic': item.topic,
        **({'assumed': True} if item.is_assumed else {}),
        'messages': item.messages,
        'used': item.used,
        'without_value': item.without_value,
        'share': item.used / item.messages if item.messages else None,
        'span': [number(value) for value in item.span],
        'si_span': [number(value) for value in item.si_span],
        'values': item.values,
        'rate': number(item.gaps.rate),
        'gaps': item.gaps.count,
        'longest_gaps': [{'time': gap.start_ns, 'seconds': gap.seconds} for gap in item.gaps.longest],
        'source_faults': [
            {'fault': fault.kind.value, 'since': fault.since_ns, 'raised': fault.raised_ns}
            for fault in item.sources
        ],
        'questions': list(item.questions),
        'fault': item.fault or None,
    }
