# SPDX-License-Identifier: Apache-2.0
"""Manoeuvres of one bearing without faults, and the judgement of what is reported meanwhile.

The shaft falls slowly through the fold below the Hopf speed, rises into the bistable range while
the lining sticks, leaves it, enters it from above, falls again, and at last a second publisher
sends another speed. Each alarm must come near its time by closed form, and be heard.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Set
from typing import NamedTuple

from true_bearing import TrueBearing

STICKING = frozenset(('stick_slip', 'amplitude_limit'))
"""Conditions while the lining sticks; alarms of the same names."""
LADDER_ALARMS = frozenset(('margin_low', 'bistable', 'stick_slip', 'amplitude_limit'))
DURATION = 330.0
"""How long they take at most [s]."""
FAR, SLOW_FALL = 2.5, 0.05
"""Speed from which the shaft falls [fold speeds], and how fast [fold speeds a second]."""
LEAD = 8.0
"""Least warning before a slow fall reaches the fold [s]: ``look_ahead`` is 20 s less on-delay, lags
and two gaps of at most 1.8 s (measured: 9.6 to 17.6 s); the margin alone gives at most 4 s."""
NEAR_ONSET = 3.6
"""Stick-slip is reported this near its onset by closed form [s]: two gaps of at most 1.8 s (measured:
-0.2 to 1.6 s). 24 e-folds in place of three take 15 s longer."""
SOUND_WITHIN = 16.0
"""What comes again within ten minutes of a sound sounds once it has lasted 15 s."""
MIX_FOUND = 9.5
"""Two publishers are found within this time [s]: twelve jumps and back (measured: up to 9 s of 0.3 s a
sample with some lost). An alarm with an off-delay of 5 s may clear before; one of 10 s may not."""
MAX_SOUNDS = 4
"""Of a bearing in all manoeuvres: bistable and stick-slip, each entered twice."""


class Report(NamedTuple):
    """Conditions and alarms of a bearing at a time, as the monitor publishes them."""

    time: float
    condition: str
    sounding: frozenset[str]  # kinds of alarm
    active: frozenset[str]


class Manoeuvres:
    """Steers a bearing and judges the reports; :meth:`sail` goes on by one step at each ``next``.

    Attributes:
        faults: What was not as it should be.
        sounds: How often the bearing began to sound.
        acknowledges: Whether somebody acknowledges all alarms now.
        mixed: Whether a second publisher sends another speed now.
    """

    def __init__(self, name: str, truth: TrueBearing) -> None:
        self._name, self._truth = name, truth
        self._reports: list[Report] = []
        self.faults: list[str] = []
        self.sounds = 0
        self.acknowledges = self.mixed = False

    def take(self, report: Report) -> None:
        """Take what is shown now."""
        silent = not self._reports or not self._reports[-1].sounding
        self.sounds += int(silent and bool(report.sounding))
        self._reports.append(report)

    def sail(self) -> Iterator[None]:
        """Steer and judge to the end."""
        truth, side = self._truth, math.copysign(1.0, self._truth.share)
        # Waits are so long that nothing is raised within six off-delays of being cleared: it would
        # be held for as long.
        wait = 20.0 if abs(truth.share) > 1.0 else 95.0
        truth.steer(FAR * side, 10.0)
        yield from self._wait_for(wait)
        yield from self._acknowledge_alarms()
        self._expect_condition({'normal'}, 'far from the fold')
        yield from self._fall_slowly(side)
        truth.steer(truth.middle * side, 5.0)
        yield from self._wait_for(25.0)
        self._expect_condition(STICKING, 'in the bistable range, from below')
        yield from self._acknowledge_alarms()
        truth.steer(1.6 * side, 3.0)
        yield from self._wait_for(30.0)
        self._expect_condition({'normal', 'caution', 'bistable'}, 'beyond the fold')
        truth.steer(truth.middle * side, 3.0)
        yield from self._wait_for(50.0)
        self._expect_condition({'bistable'}, 'in the bistable range, from above')
        yield from self._acknowledge_alarms()
        truth.steer(0.4 * side, 3.0)
        yield from self._wait_for(25.0)
        # Within two minutes of the last this is one manoeuvre, acknowledged: it may be silent.
        self._expect_condition(STICKING, 'below the Hopf speed')
        yield from self._mix_publishers()
        if self.sounds > MAX_SOUNDS:
            self._report_fault(f'{self.sounds} sounds in manoeuvres that deserve {MAX_SOUNDS}')

    def _fall_slowly(self, side: float) -> Iterator[None]:
        truth, begin = self._truth, self._truth.time
        target = 0.9 * truth.hopf
        truth.steer(target * side, (FAR - target) / SLOW_FALL)
        yield from self._wait_for(75.0)
        warned = self._first_time(begin, lambda report: report.condition != 'normal')
        if not warned <= truth.passed_fold - LEAD:
            self._report_fault(f'warned {truth.passed_fold - warned:.1f} s before the fold, not {LEAD} s')
        warned_at = self._first_time(begin, lambda report: report.condition in STICKING)
        if not abs(warned_at - truth.began) <= NEAR_ONSET:
            self._report_fault(f'stick-slip is reported {warned_at - truth.began:.1f} s after its onset')
        self._judge_sound()

    def _judge_sound(self) -> None:
        began = self._truth.began
        sounded_at = self._first_time(began - NEAR_ONSET, lambda report: bool(report.sounding & STICKING))
        if not sounded_at <= began + NEAR_ONSET + SOUND_WITHIN:
            self._report_fault(f'stick-slip sounds {sounded_at - began:.1f} s after its onset')

    def _mix_publishers(self) -> Iterator[None]:
        """Send two of three speeds from a second publisher: no alarm may clear once that is found."""
        self.mixed = True
        yield from self._wait_for(MIX_FOUND)
        active_before = self._reports[-1].active & LADDER_ALARMS
        yield from self._wait_for(25.0 - MIX_FOUND)
        cleared = active_before - self._reports[-1].active
        if cleared:
            self._report_fault(f'{", ".join(sorted(cleared))} cleared while two publishers send')

    def _acknowledge_alarms(self) -> Iterator[None]:
        self.acknowledges = True
        yield
        self.acknowledges = False

    def _wait_for(self, seconds: float) -> Iterator[None]:
        end = self._truth.time + seconds
        while self._truth.time < end:
            yield

    def _first_time(self, since: float, holds: Callable[[Report], bool]) -> float:
        times = (report.time for report in self._reports if report.time >= since and holds(report))
        return next(times, math.inf)

    def _expect_condition(self, conditions: Set[str], situation: str) -> None:
        condition = self._reports[-1].condition
        if condition not in conditions:
            self._report_fault(f'{condition} is reported {situation}')

    def _report_fault(self, text: str) -> None:
        self.faults.append(f'{self._name}, at {self._truth.time:.1f} s: {text}')
