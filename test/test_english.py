# SPDX-License-Identifier: Apache-2.0
"""Names and docstrings say by themselves what they are about; what does not yet only becomes less."""

from __future__ import annotations

import pytest
from plain_english import FindingKind, count_by_room, find_in_source

# Findings of `python scripts/plain_english.py` in each room: lower a number as you rewrite, never raise it.
MOST = {'stickslip_monitor/monitor': 4}


def test_no_room_has_more_findings_than_before() -> None:
    counts = count_by_room()
    risen = {room: (MOST.get(room, 0), count) for room, count in counts.items() if count > MOST.get(room, 0)}
    assert not risen, f'{risen}: see python scripts/plain_english.py ROOM'


def test_the_numbers_are_lowered_as_findings_go() -> None:
    counts = count_by_room()
    fallen = {
        room: counts.get(room, 0) for room, max_count in MOST.items() if counts.get(room, 0) < max_count
    }
    assert not fallen, f'write these numbers into MOST: {fallen}'


@pytest.mark.parametrize(
    ('source', 'kinds'),
    [
        ('def read_rows():\n    """Return the rows."""\n', []),
        ('def read_rows():\n    """The rows of a table."""\n', [FindingKind.NOUN]),
        ('def read_rows():\n    """What came of it."""\n', [FindingKind.CLAUSE]),
        ('def is_open():\n    """Whether it is open."""\n', [FindingKind.CLAUSE]),
        ('@property\ndef is_open(self):\n    """Whether it is open."""\n', []),
        ('@property\ndef rows(self):\n    """The rows of a table."""\n', []),
        ('class Row:\n    """A row of a table."""\n', []),
        ('class Row:\n    """What a table has."""\n', [FindingKind.CLAUSE]),
        ('async def _rows(): ...', [FindingKind.ONE_WORD]),
        ('def __iter__(): ...', []),
        ('def _read_rows(): ...', []),
        ('@property\ndef _rows(self): ...', []),
        ('def f(own): ...', [FindingKind.VAGUE]),
        ('for each in rows: pass', [FindingKind.VAGUE]),
        ('rows = f(own)', []),
    ],
)
def test_findings_of_a_source(source: str, kinds: list[FindingKind]) -> None:
    assert [finding.kind for finding in find_in_source(source)] == kinds
