#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the changes of condition over recordings and random sequences, or lists what differs.

The cases are the recordings of bags/ with the configurations of their scenes, and the sequences
of test/monitor/sequences.py. ``--compare`` runs them and lists every kind of difference from the
file, with counts and examples; the reasons belong into docs/design.md before the file is made
anew.
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
import json
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'test' / 'monitor'))

from sequences import COUNT, NAME, QUANTITIES, sequence  # noqa: E402

from stickslip_monitor import Monitor  # noqa: E402
from stickslip_monitor.monitor.parameter_file import load_config, load_yaml  # noqa: E402
from stickslip_monitor.monitor.sample_types import Status  # noqa: E402
from stickslip_monitor.offline.check import check_recording  # noqa: E402

GOLDEN = ROOT / 'test' / 'data' / 'golden.json.gz'
MOVED_NS = 10**9
"""A change this much earlier or later is listed as moved [ns]."""
SAME_NS = 30 * 10**9
"""Changes of one kind further apart than this are two [ns]."""
_STATUSES = len(Status)

Change = tuple[int, str, str, bool]
Case = dict[str, Any]


def main(argv: Sequence[str] | None = None) -> int:
    """Make or compare; returns the exit code: 1 where something differs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--compare', action='store_true', help='list differences, write nothing')
    parser.add_argument('--only', default='', help='cases whose names contain this')
    parser.add_argument('--examples', type=int, default=3, help='of each kind of difference')
    args = parser.parse_args(argv)
    cases = dict(all_cases(args.only))
    lines = list(list_differences(read_golden(), cases, args.examples)) if GOLDEN.exists() else []
    print('\n'.join(lines) or 'no difference')
    if args.compare:
        return int(bool(lines))
    GOLDEN.parent.mkdir(exist_ok=True)
    if args.only:
        cases = read_golden() | cases
    text = json.dumps(cases, separators=(',', ':'))
    GOLDEN.write_bytes(gzip.compress(text.encode('utf-8'), mtime=0))
    print(f'{len(cases)} cases, {sum(len(c["changes"]) for c in cases.values())} changes')
    return 0


def read_golden() -> dict[str, Case]:
    """Return the cases of the file by name."""
    cases: dict[str, Case] = json.loads(gzip.decompress(GOLDEN.read_bytes()))
    return cases


def all_cases(only: str = '') -> Iterator[tuple[str, Case]]:
    """Run the cases whose names contain a text; yield them by name."""
    bags = sorted(path.name for path in (ROOT / 'bags').iterdir() if path.is_dir())
    for bag in bags:
        if only in f'bag {bag}':
            yield from of_bag(bag)
    for number in range(COUNT):
        if only in f'sequence {number}':
            yield f'sequence {number}', of_sequence(number)


def of_bag(name: str) -> Iterator[tuple[str, Case]]:
    """Check a recording with the configuration of its scene; yield its bearings."""
    scene = ROOT / 'launch_configs' / 'scenes' / f'{name}.yaml'
    config = load_config(scene.parent / load_yaml(scene)['config'])
    report = check_recording(ROOT / 'bags' / name, config)
    for bearing, bearing_report in report.bearings.items():
        counts = {item.quantity: [item.messages, item.used] for item in bearing_report.inputs}
        changes = [_change_row(event) for event in bearing_report.events]
        yield f'bag {name} {bearing}', _make_case(changes, counts, report.end_ns or 0, b'')


def of_sequence(number: int) -> Case:
    """Run a sequence through the live monitor, sample by sample."""
    voyage = sequence(number)
    monitor = Monitor(voyage.config)
    events = [] if voyage.start_ns is None else monitor.advance(voyage.start_ns)
    statuses = np.empty(voyage.messages.value.size, np.int8)
    for k, sample in enumerate(voyage.samples()):
        update = monitor.update(sample)
        events += update.events
        statuses[k] = update.status
    events += monitor.advance(voyage.end_ns)
    assert all(event.bearing == NAME for event in events)
    counts = {
        quantity: np.bincount(statuses[voyage.messages.quantity == k], minlength=_STATUSES).tolist()
        for k, quantity in enumerate(QUANTITIES)
    }
    changes = [_change_row(event) for event in events]
    return _make_case(changes, counts, int(voyage.messages.arrival_ns.max()), statuses.tobytes())


def _change_row(event: Any) -> Change:
    return event.time_ns, str(event.before), str(event.after), bool(event.standing.sticking)


def _make_case(changes: list[Change], counts: Any, end_ns: int, statuses: bytes) -> Case:
    content = {'changes': [list(change) for change in changes], 'counts': counts, 'end_ns': end_ns}
    digest = hashlib.sha256(json.dumps(content).encode('utf-8') + statuses).hexdigest()[:16]
    return {**content, 'digest': digest}


def list_differences(golden: dict[str, Case], current: dict[str, Case], examples: int) -> Iterator[str]:
    """List every kind of difference with how often it occurs and where, most frequent first."""
    kinds: dict[str, list[str]] = defaultdict(list)
    for name, new in current.items():
        old = golden.get(name)
        if old is None:
            kinds['a case that the file does not have'].append(name)
        elif old['digest'] != new['digest']:
            for kind, place in _of_case(old, new):
                kinds[kind].append(f'{name} {place}')
    for kind, places in sorted(kinds.items(), key=lambda item: -len(item[1])):
        cases = len({place.split(' at ')[0] for place in places})
        yield f'{len(places):5d} in {cases:3d} cases  {kind}'
        yield from (f'{"":8}{place}' for place in places[:examples])
    yield from _times_apart(golden, current)


def _of_case(old: Case, new: Case) -> Iterator[tuple[str, str]]:
    """Yield each difference of a case: its kind, and where it is."""
    for quantity, count in old['counts'].items():
        if count != new['counts'][quantity]:
            yield f'counts of {quantity}', f'{count} now {new["counts"][quantity]}'
    if old['changes'] == new['changes'] and old['counts'] == new['counts']:
        yield 'another sample has the status', ''
    start_ns = min((change[0] for change in old['changes'] + new['changes']), default=0)
    for kind, time_ns, text in _of_changes(old['changes'], new['changes']):
        yield kind, f'at +{(time_ns - start_ns) / 1e9:.3f} s {text}'


def _of_changes(old: list[Any], new: list[Any]) -> Iterator[tuple[str, int, str]]:
    common = Counter(map(tuple, old)) & Counter(map(tuple, new))
    removed, added = (_remove_common(changes, common.copy()) for changes in (old, new))
    for old_change, new_change in _pair_changes(removed, added, SAME_NS, same_kind=True):
        off = (new_change[0] - old_change[0]) / 1e9
        if old_change[0] == new_change[0]:
            yield (
                f'{_change_kind(old_change)}: growth {old_change[3]} is now {new_change[3]}',
                old_change[0],
                '',
            )
        else:
            size = 'by more than 1 s' if abs(new_change[0] - old_change[0]) > MOVED_NS else 'by up to 1 s'
            direction = 'later' if off > 0 else 'earlier'
            yield f'{_change_kind(old_change)}: {direction} {size}', old_change[0], f'{off:+.3f} s'
    for old_change, new_change in _pair_changes(removed, added, MOVED_NS, same_kind=False):
        yield f'{_change_kind(old_change)}: renamed {_change_kind(new_change)}', old_change[0], ''
    yield from ((f'{_change_kind(change)}: gone', change[0], '') for change in removed)
    yield from ((f'{_change_kind(change)}: new', change[0], '') for change in added)


def _remove_common(changes: list[Any], common: Counter[Any]) -> list[Any]:
    """Return the changes that are not common to both."""
    remaining = []
    for change in map(tuple, changes):
        if common[change]:
            common[change] -= 1
        else:
            remaining.append(change)
    return remaining


def _pair_changes(
    removed: list[Any], added: list[Any], within_ns: int, *, same_kind: bool
) -> Iterator[tuple[Any, Any]]:
    """Take out of both lists what belongs together, nearest in time; yield the pairs."""
    for change in list(removed):
        near = [c for c in added if not same_kind or c[1:3] == change[1:3]]
        nearest = min(near, key=lambda c: abs(c[0] - change[0]), default=None)
        if nearest is not None and abs(nearest[0] - change[0]) <= within_ns:
            removed.remove(change)
            added.remove(nearest)
            yield change, nearest


def _change_kind(change: Any) -> str:
    return f'{change[1]} > {change[2]}'


def _times_apart(golden: dict[str, Case], current: dict[str, Case]) -> Iterator[str]:
    """List for how long which condition stands where another stood."""
    apart: Counter[tuple[str, str]] = Counter()
    for name in current.keys() & golden.keys():
        apart.update(_time_apart(golden[name], current[name]))
    for (old_condition, new_condition), lasting in apart.most_common():
        yield f'{lasting / 3.6e12:8.3f} h  {old_condition} is now {new_condition}'


def _time_apart(old: Case, new: Case) -> Counter[tuple[str, str]]:
    """Return the time [ns] by the condition of both, where they differ; clock jumps end it."""
    edges = sorted({c[0] for c in chain(old['changes'], new['changes'])} | {old['end_ns']})
    spent: Counter[tuple[str, str]] = Counter()
    for begin, end in pairwise(edges):
        pair = _condition_at(old['changes'], begin), _condition_at(new['changes'], begin)
        if pair[0] != pair[1]:
            spent[pair] += end - begin
    return spent


def _condition_at(changes: list[Any], time_ns: int) -> str:
    last = 'normal'
    for change in changes:
        if change[0] > time_ns:
            break
        last = change[2]
    return last


if __name__ == '__main__':
    sys.exit(main())
