# SPDX-License-Identifier: Apache-2.0
"""The library's bags, scored: no episode missed, no alarm without cause, leads as documented.

When an alarm is due is held to closed forms in test/lab/test_recordings.py.
"""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from benchmarks.voyages import OURS, judge_bag
from benchmarks.warning_quality import Quality, pooled
from stickslip_monitor.lab.scene import load_scene

ROOT = Path(__file__).parents[2]
ENTRIES: dict[str, dict[str, Any]] = json.loads((ROOT / 'bags' / 'manifest.json').read_text('utf-8'))['bags']
# Bags with the truth about their lining.
TOLD = [
    name
    for name, entry in ENTRIES.items()
    if 'lining_motion' in {s.name for s in load_scene(ROOT / entry['scene']).effects}
]


@cache
def judged(name: str) -> dict[str, Quality]:
    config = load_scene(ROOT / ENTRIES[name]['scene']).config
    found = judge_bag(ROOT / 'bags' / name, config)
    return {voyage.bearing: voyage.rules[OURS] for voyage, _ in found}


# Where the shaft breaks away from rest no warning can come before, and the speed sensor of one is
# stuck while the shaft passes the Hopf speed.
LATE = {'cold_start': 1, 'manoeuvring': 1, 'crash_stop': 1, 'sensor_values': 1}


@pytest.mark.parametrize('name', TOLD)
def test_no_episode_is_missed_and_no_alarm_is_false(name: str) -> None:
    for bearing, quality in judged(name).items():
        episodes = [e for e in ENTRIES[name]['episodes'] if e['bearing'] == bearing]
        assert (quality.episodes, quality.missed, quality.false) == (len(episodes), 0, 0)
        late = sum(lead < 0.0 for lead in quality.leads)
        assert late == (LATE.get(name, 0) if episodes else 0)
        # A cycle dies out in 1.2 s, and the alarm is off 5 s later.
        if name in ('history_above', 'voyage', 'coast_down'):
            assert quality.unfounded <= quality.episodes * (3.0 + 1.2 + 5.0 + 1.5)


def test_the_docs_say_what_the_library_shows() -> None:
    """The table of docs/warning_quality.md, to the digits it has."""
    page = (ROOT / 'docs' / 'warning_quality.md').read_text('utf-8')
    rows = re.findall(r'^\| `(\w+)` \| (\d+) \|(.*?)\|(.*?)\|(.*?)\|', page, flags=re.MULTILINE)
    assert {row[0] for row in rows} == set(TOLD)
    for name, episodes, *figures in rows:
        total = pooled(judged(name).values())
        assert int(episodes) == total.episodes
        wrong = [total.unfounded + total.unalarmed]
        for text, values in zip(figures, (total.leads, total.alarm_leads, wrong), strict=True):
            shown = text.strip()
            assert shown == (f'{min(values):.1f}' if values else 'none' if total.episodes else '')
