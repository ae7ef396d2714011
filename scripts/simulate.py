#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Sails ships under faults, a seed each, and prints those with a wrong condition or alarm."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path

TEST = Path(__file__).resolve().parents[1] / 'test'
sys.path[:0] = [str(TEST / folder) for folder in ('', 'logs', 'monitor')]
from simulation import DURATION, repeated_by, runs  # noqa: E402


def main() -> int:
    """Try seeds; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seconds', type=float, default=1e6, help='of ship, in all')
    parser.add_argument('--first', type=int, default=0, help='the first seed')
    parser.add_argument('--seed', type=int, help='this one alone')
    parser.add_argument('--jobs', type=int, default=2, help='processes')
    args = parser.parse_args()
    seeds = range(args.first, args.first + max(round(args.seconds / DURATION), 1))
    if args.seed is not None:
        seeds = range(args.seed, args.seed + 1)
    wrong, settled, sounds, bad = Counter[str](), 0, 0, 0
    for outcome in runs(seeds, 1 if args.seed is not None else args.jobs):
        wrong, settled = wrong + outcome.wrong, settled + outcome.settled
        sounds += outcome.sounds
        if outcome.faults:
            bad += 1
            print(*outcome.faults, repeated_by(outcome.seed), sep='\n    ', flush=True)
    reported = ', '.join(f'{pair} {count}' for pair, count in sorted(wrong.items())) or 'none'
    print(f'{len(seeds)} runs, {bad} not as they should be.')
    print(f'Of {settled} s a minute after any change, wrong under faults: {reported}.')
    print(f'{sounds} sounds in the manoeuvres of {2 * len(seeds)} bearings.')
    return int(bad > 0)


if __name__ == '__main__':
    sys.exit(main())
