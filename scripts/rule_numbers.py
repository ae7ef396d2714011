#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What each number of the rule earns: voyages judged with another value, one number at a time.

The figures of docs/rule.md, "Why these numbers", come from it; a seed takes minutes. The voyages are those
of docs/warning_quality.md, by several senders. A number is one of the rule's constants, `HOLD=0`, or a
parameter of the alarm, `onset_growth=2`; `middle=first` leaves the medians out.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from unittest import mock

import numpy as np
from hard_sensors import send_unevenly

from benchmarks.table import format_row
from benchmarks.voyages import Sailed, SensorRecord, cases_of, output_of, sounds_of
from benchmarks.warning_quality import FIGURES, Quality, format_figure, pool_qualities, quality_of
from stickslip_lab.scenes.scene import load_scene
from stickslip_lab.scenes.truth_topics import TruthRecord
from stickslip_monitor.monitor import rule, rule_settings, rule_state, vibration_rule
from stickslip_monitor.monitor.rule_over_arrays import BearingScan
from stickslip_monitor.offline.processes import core_count, run_in_processes

CONFIGS = Path(__file__).resolve().parents[1] / 'launch_configs'
WRONG_SOURCE = 'two_publishers'
NUMBERS = ('HOLD=0', 'middle=first', 'DECAY=0', 'onset_growth=2', 'onset_growth=4')
SHOWN = (
    *('false_per_100h', 'wrong_hours', 'unfounded_hours', 'missed', 'detected', 'told', 'newly_given'),
    *('far_warned', 'changes_per_hour', 'largest_burst', 'sounds'),
)
Spoil = Callable[[SensorRecord, np.random.Generator], SensorRecord]


def send_every(sent: SensorRecord, _: np.random.Generator, seconds: float) -> SensorRecord:
    """Send speed and load once in some seconds."""
    return send_unevenly(sent, lambda count: np.full(count, seconds))


def at_random(sent: SensorRecord, random: np.random.Generator) -> SensorRecord:
    """They are sent once a second on average."""
    return send_unevenly(sent, lambda count: random.exponential(1.0, count))


SENDERS: Mapping[str, tuple[str, Spoil]] = {
    'ordinary, 5 Hz': ('ordinary', lambda sent, _: sent),
    'every second': ('ordinary', partial(send_every, seconds=1.0)),
    'every 3 s': ('ordinary', partial(send_every, seconds=3.0)),
    'every 10 s': ('ordinary', partial(send_every, seconds=10.0)),
    'at random, 1 Hz': ('ordinary', at_random),
    'poor, 1 Hz': ('poor', lambda sent, _: sent),
}
"""By name: the file of sensors, and what becomes of what they send."""


def judge_voyage(scene: str, seed: int, numbers: Sequence[str]) -> dict[tuple[str, str], Quality]:
    """Return the quality on one voyage by sender and number."""
    truths: dict[str, TruthRecord] = {}
    qualities: dict[tuple[str, str], list[Quality]] = {}
    for grade in ('ordinary', 'poor'):
        sensors = str(CONFIGS / 'sensors' / f'{grade}.yaml')
        for case in cases_of(load_scene(scene, seed, sensors), truths):
            for k, (sender, (sensor_grade, spoil)) in enumerate(SENDERS.items()):
                sent = spoil(case.sent, np.random.default_rng([seed, k])) if sensor_grade == grade else None
                for number in numbers if sent is not None else ():
                    qualities.setdefault((sender, number), []).append(_judge_with_number(case, sent, number))
    return {key: pool_qualities(parts) for key, parts in qualities.items()}


def _judge_with_number(case: Sailed, sent: SensorRecord, number: str) -> Quality:
    """Judge a voyage by the rule with another number; '' changes nothing."""
    name, _, value = number.partition('=')
    config, first = sent.config, lambda latest, *_: latest
    with ExitStack() as changed:
        if hasattr(config.alarm, name):
            config = replace(config, alarm=replace(config.alarm, **{name: float(value)}))
        for module in (rule, rule_settings, rule_state, vibration_rule):
            if hasattr(module, name):
                new_value = first if value == 'first' else type(getattr(module, name))(float(value))
                changed.enter_context(mock.patch.object(module, name, new_value))
        # Interpreted: what is compiled has the numbers of its first run.
        scan = BearingScan(config, sent.start_ns, long=False).finish(sent.stream, sent.end_ns)
    truth = case.truth
    sounds, unheard = sounds_of(scan, truth.start_ns, truth.end_ns)
    output = replace(output_of(scan, truth), sounds=sounds, unheard=unheard)
    return quality_of(output, truth, case.plain)


def _format_rows(by_case: Mapping[tuple[str, str], Sequence[Quality]]) -> Iterator[str]:
    for cells in (['sender', 'number', *(FIGURES[name][0] for name in SHOWN)], ['---'] * (len(SHOWN) + 2)):
        yield format_row(cells)
    for (sender, number), parts in sorted(by_case.items(), key=lambda item: list(SENDERS).index(item[0][0])):
        figures = pool_qualities(parts).figures()
        yield format_row([sender, number, *(format_figure(name, figures[name]) for name in SHOWN)])


def main() -> int:
    """Judge and print a table; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('numbers', nargs='*', default=NUMBERS, help='name=value, each by itself')
    parser.add_argument('--seeds', type=int, default=4, help='seeds of each scene')
    parser.add_argument('--first-seed', type=int, default=601, help='the first of them')
    parser.add_argument('--jobs', type=int, default=core_count(), help='processes')
    args = parser.parse_args()
    scenes = [s for s in sorted((CONFIGS / 'scenes' / 'quality').glob('*.yaml')) if s.stem != WRONG_SOURCE]
    seeds = range(args.first_seed, args.first_seed + args.seeds)
    calls = dict(enumerate((str(scene), seed, ('', *args.numbers)) for scene in scenes for seed in seeds))
    by_case: dict[tuple[str, str], list[Quality]] = {}
    for _, outcome in run_in_processes(judge_voyage, calls, args.jobs):
        if isinstance(outcome, BaseException):
            raise outcome
        for key, quality in outcome.items():
            by_case.setdefault(key, []).append(quality)
    print('\n'.join(_format_rows(by_case)))
    return 0


if __name__ == '__main__':
    sys.exit(main())
