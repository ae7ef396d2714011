# SPDX-License-Identifier: Apache-2.0
"""The library's bags, scored: no episode missed, no alarm without cause, and how much lead.

At 1000 N caution begins at 44.80 rpm at the latest, and sooner where the speed falls; the fold is
at 40.72 rpm and the Hopf speed at 30.74 rpm. A warning comes 2 s after its cause; the alarm comes
when a disturbance has grown by three e-folds, and before it has grown by six, where it sticks.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from stickslip_monitor.lab.scenes.scene import load_scene
from stickslip_monitor.lab.voyages import OURS, judge_bag
from stickslip_monitor.lab.warning_quality import Quality, pooled

ROOT = Path(__file__).parents[2]
ENTRIES: dict[str, dict[str, Any]] = json.loads(
    (ROOT / 'bags' / 'manifest.json').read_text('utf-8')
)['bags']
# Bags with the truth about their lining.
TOLD = [
    name
    for name, entry in ENTRIES.items()
    if 'lining_motion' in {s.name for s in load_scene(ROOT / entry['scene']).effects}
]


@dataclass(frozen=True)
class Figures:
    """What a bag's judgement must come to.

    ``lead`` and ``alarm_lead`` are the least that the scene allows [s], None where stick-slip is
    never predicted; ``unpredicted`` is the most time of sticking that is not predicted [s];
    ``late`` counts episodes that no alarm can announce in time.
    """

    episodes: int
    lead: float | None = None
    alarm_lead: float | None = None
    unpredicted: float = 0.0
    late: int = 0


# By bag and bearing. In coast_down from 44.8 to 30.74 rpm at 0.45 rpm/s, and more until it grows.
LIBRARY = {
    'coast_down': {'aft_stern': Figures(1, (44.8 - 30.74) / 0.45 - 2.0, 0.0)},
    # From 463 N (caution) to 570 N (Hopf) at 5 N/s.
    'load_excursion': {'aft_stern': Figures(1, (570.0 - 463.0) / 5.0 - 2.0, 0.0)},
    'history_above': {'aft_stern': Figures(0)},
    # It starts inside the unstable region: the growth decides whether 2 s of delay are too many.
    'history_below': {'aft_stern': Figures(1, 0.0, 0.0)},
    # From 44.8 rpm at 0.48 rpm/s on; the blow that starts it is at 130 s.
    'bistable_knock': {
        'aft_stern': Figures(1, 130.0 - (10.0 + (60.0 - 44.8) / 0.48) - 2.0 - 4.0, None, 53.0)
    },
    # The level takes three seconds, and comes twice a second.
    'measured_knock': {
        'aft_stern': Figures(1, 130.0 - (10.0 + (60.0 - 44.8) / 0.48) - 2.0 - 4.0, -4.0, 4.0)
    },
    # With the first turn of the shaft: nothing can warn before, and the delay is 2 s. At 44 rpm
    # the configured law has no cycle, and the new lining sticks until it has run in.
    'cold_start': {'aft_stern': Figures(1, -2.4, -2.4, 2.4 + 330.0 - 106.6, late=1)},
    # From caution to Hopf, at 41 rpm a minute.
    'two_bearings': {'aft_stern': Figures(1, 26.0 - 2.0, 0.0), 'fore_stern': Figures(0)},
    # At 42 rpm the configured law says caution; a week's slow steaming lasts 22 s.
    'wear': {'aft_stern': Figures(3, 2.0, None, 3 * 25.0)},
    'voyage': {'aft_stern': Figures(0)},
    # Stops at 180, 300 and 510 s, starts at 240, 360 and 570 s; the second start goes over into a
    # stop and astern without a rest: six. From rest nothing can warn before; to the delay comes
    # that the shaft meter averages over a second.
    # After a stop longer than the hold of a minute a start is late.
    'manoeuvring': {'aft_stern': Figures(6, -3.4, -3.4, 3 * 3.4, late=1)},
    # In caution from 60 s on, but for one wave, and never predicted: each of the two episodes
    # lasts to the next trough.
    'slow_steaming_waves': {'aft_stern': Figures(2, 309.5 - 60.0 - 8.0 - 2.0, None, 2 * 8.0)},
    # From 691 N (caution) to 1069 N (Hopf) in half a minute of 680 N; the filter takes a second.
    'trim_change': {'aft_stern': Figures(1, 378.0 / 680.0 * 30.0 - 2.0 - 1.0 - 0.5, 0.0)},
    # From ahead to astern, to rest, and from rest. From 95 to -75 rpm with a lag of 10 s the shaft
    # takes 1.3 s from caution to Hopf: less than the delay, but the trend tells. The start from
    # rest is late, as in cold_start.
    'crash_stop': {'aft_stern': Figures(3, -2.4, -2.4, 2 * 2.4, late=1)},
    # The speed sensor is stuck until 500 s; the shaft has passed the Hopf speed at 455 s.
    'sensor_values': {'aft_stern': Figures(1, -47.5, -47.5, 47.5, late=1)},
    # From 44.8 to 30.74 rpm at 0.4 rpm/s.
    'sensor_clocks': {'aft_stern': Figures(1, (44.8 - 30.74) / 0.4 - 2.0 - 0.5, 0.0)},
    # The same at 0.5 rpm/s.
    'cut_short': {'aft_stern': Figures(1, (44.8 - 30.74) / 0.5 - 2.0 - 0.5, 0.0)},
}


@cache
def judged(name: str) -> dict[str, Quality]:
    config = load_scene(ROOT / ENTRIES[name]['scene']).config
    found = judge_bag(ROOT / 'bags' / name, config)
    return {one.config.name: one.voyage.rules[OURS] for one in found}


@pytest.mark.parametrize('name', TOLD)
def test_no_episode_is_missed_and_no_alarm_is_false(name: str) -> None:
    found = judged(name)
    assert list(found) == list(LIBRARY[name])
    for bearing, quality in found.items():
        figures = LIBRARY[name][bearing]
        assert (quality.episodes, quality.missed) == (figures.episodes, 0)
        # Where the shaft breaks away from rest, physics leaves no time to warn.
        late = sum(lead < 0.0 for lead in quality.leads)
        assert (late, quality.false) == (figures.late, 0)
        assert quality.unalarmed <= figures.unpredicted
        for leads, least in (
            (quality.leads, figures.lead), (quality.alarm_leads, figures.alarm_lead),
        ):  # fmt: skip
            assert bool(leads) == (least is not None)
            assert least is None or min(leads) >= least
        # A cycle dies out in 1.2 s, and the alarm is off 5 s later.
        if name in ('history_above', 'voyage', 'coast_down'):
            assert quality.unfounded <= quality.episodes * (3.0 + 1.2 + 5.0 + 1.5)


def test_the_docs_say_what_the_library_shows() -> None:
    """The table of docs/warning_quality.md, to the digits it has."""
    page = (ROOT / 'docs' / 'warning_quality.md').read_text('utf-8')
    rows = re.findall(r'^\| `(\w+)` \| (\d+) \|(.*?)\|(.*?)\|(.*?)\|', page, flags=re.MULTILINE)
    assert {row[0] for row in rows} == set(LIBRARY)
    for name, episodes, *figures in rows:
        total = pooled(judged(name).values())
        assert int(episodes) == total.episodes
        wrong = [total.unfounded + total.unalarmed]
        for text, values in zip(figures, (total.leads, total.alarm_leads, wrong), strict=True):
            shown = text.strip()
            assert shown == (f'{min(values):.1f}' if values else 'none' if total.episodes else '')
