# SPDX-License-Identifier: Apache-2.0
"""The changes of condition over recordings and random sequences are those of the golden file.

A change of the rule changes them: `scripts/make_golden.py --compare` lists the kinds of
differences, `scripts/make_golden.py` makes the file anew.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from make_golden import list_differences, of_bag, of_sequence, read_golden
from sequences import COUNT, sequence

GOLDEN = read_golden()
BAGS = sorted({name.split()[1] for name in GOLDEN if name.startswith('bag ')})
# All of them take minutes, since the table law is slow: `scripts/make_golden.py --compare`.
QUICK = [k for k in range(0, COUNT, 4) if sequence(k).bearing != 'table'][:40]


def test_every_recording_is_in_the_golden_file() -> None:
    folder = Path(__file__).resolve().parents[3] / 'bags'
    assert sorted(path.name for path in folder.iterdir() if path.is_dir()) == BAGS
    assert sum(name.startswith('sequence') for name in GOLDEN) == COUNT


@pytest.mark.parametrize('bag', BAGS)
def test_recording(bag: str) -> None:
    assert list(list_differences(GOLDEN, dict(of_bag(bag)), examples=9)) == []


@pytest.mark.parametrize('number', QUICK)
def test_sequence(number: int) -> None:
    events = {f'sequence {number}': of_sequence(number)}
    assert list(list_differences(GOLDEN, events, examples=9)) == []
