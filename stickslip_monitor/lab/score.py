# SPDX-License-Identifier: Apache-2.0
"""Sets of time: sorted, disjoint intervals [ns], each with its begin and without its end.

Judges a monitor's warnings by what the lining really did.

The truth is of two kinds. *Episodes* of stick-slip say what happened; the *true margins*, of the
operating point without noise and of the friction there really was, say what could happen. A
warning is judged by what it claims:

============================  ==========================================================
condition                     true where
============================  ==========================================================
caution                       the true fold margin is within the caution band
bistable                      the true fold margin is below zero
stick-slip, amplitude limit   the lining is in an episode, or the true Hopf margin is below
                              zero, where stick-slip starts by itself
============================  ==========================================================

So a bistable bearing that nothing disturbs is no false alarm, and caution before an episode is
lead. A lost input claims nothing: the alarm that stood before it goes on.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.monitor.config import AlarmConfig
from stickslip_monitor.monitor.ladder import LADDER, Condition
from stickslip_monitor.monitor.verdict import Event
from stickslip_monitor.offline.intervals import condition_intervals

Interval = tuple[int, int]
Intervals = Sequence[Interval]


def merged(intervals: Iterable[Interval]) -> list[Interval]:
    """Sort intervals, join those that overlap or touch, and drop the empty ones."""
    found: list[Interval] = []
    for start, end in sorted(intervals):
        if end <= start:
            continue
        if found and start <= found[-1][1]:
            found[-1] = (found[-1][0], max(end, found[-1][1]))
        else:
            found.append((start, end))
    return found


def intersection(first: Intervals, second: Intervals) -> list[Interval]:
    """What two sets have in common."""
    found: list[Interval] = []
    i = k = 0
    while i < len(first) and k < len(second):
        start, end = max(first[i][0], second[k][0]), min(first[i][1], second[k][1])
        if start < end:
            found.append((start, end))
        if first[i][1] <= second[k][1]:
            i += 1
        else:
            k += 1
    return found


def seconds(intervals: Iterable[Interval]) -> float:
    """Length of a set [s]."""
    return sum(end - start for start, end in intervals) / 1e9


_CAUTION, _BISTABLE, _STICK_SLIP = (
    LADDER.index(c) for c in (Condition.CAUTION, Condition.BISTABLE, Condition.STICK_SLIP)
)


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """What the lining of one bearing did, from ``start_ns`` to ``end_ns``.

    Attributes:
        start_ns: From when on it is known [ns].
        end_ns: Until when it is known [ns].
        episodes: First and last instant of sticking of each episode of stick-slip; one that was
            still going on ends with the truth.
        time_ns: When the margins were taken, shape (n,), rising [ns].
        hopf_margin: True Hopf margin, shape (n,).
        fold_margin: True fold margin, shape (n,).
    """

    start_ns: int
    end_ns: int
    episodes: tuple[Interval, ...]
    time_ns: NDArray[np.int64]
    hopf_margin: NDArray[np.float64]
    fold_margin: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class EpisodeScore:
    """How an episode of stick-slip was announced.

    Attributes:
        first_ns: Its first instant of sticking [ns].
        last_ns: Its last one [ns].
        lead: From the warning that stood at the first stick to that stick [s]; negative where
            the bearing was normal then and the warning came late; ``None`` without any.
        alarm_lead: The same for the prediction of stick-slip (the conditions of level ERROR).
        blind: Whether an input was lost at the first stick.
    """

    first_ns: int
    last_ns: int
    lead: float | None
    alarm_lead: float | None
    blind: bool

    @property
    def missed(self) -> bool:
        """Whether nothing warned of it, from before its first to its last stick."""
        return self.lead is None

    @property
    def late(self) -> bool:
        """Whether the first warning came after the first stick."""
        return self.lead is not None and self.lead < 0.0


@dataclass(frozen=True, slots=True)
class WarningInterval:
    """A stretch of time in which the monitor warned.

    Attributes:
        start_ns: When it was raised [ns].
        end_ns: When it was cleared, or the end of what is judged [ns].
        highest: The worst condition in it.
        holds: Whether what that condition claims was true at any time of the stretch; ``None``
            where the true margins, which alone could tell, were not recorded.
    """

    start_ns: int
    end_ns: int
    highest: Condition
    holds: bool | None


@dataclass(frozen=True, slots=True)
class Score:
    """The judgement of one bearing over one recording, or of several together.

    Attributes:
        seconds: Time judged [s].
        episodes: Every episode of stick-slip.
        warnings: Every stretch in caution or bistable or above, up to the worst of these two.
        alarms: Every stretch in which stick-slip was predicted.
        sticking: Time in episodes [s].
        unpredicted: Time in episodes while stick-slip was not predicted [s].
        unwarned: Time in episodes while the condition was normal [s].
        overpredicted: Time while stick-slip was predicted and there was none [s].
        blind: Time in which an input was lost [s].
    """

    seconds: float
    episodes: tuple[EpisodeScore, ...]
    warnings: tuple[WarningInterval, ...]
    alarms: tuple[WarningInterval, ...]
    sticking: float
    unpredicted: float
    unwarned: float
    overpredicted: float
    blind: float

    @property
    def missed(self) -> int:
        """Episodes without a warning."""
        return sum(episode.missed for episode in self.episodes)

    @property
    def late(self) -> int:
        """Episodes whose warning came after the first stick."""
        return sum(episode.late for episode in self.episodes)

    @property
    def leads(self) -> list[float]:
        """Lead of each episode that was not missed [s]."""
        return [episode.lead for episode in self.episodes if episode.lead is not None]

    @property
    def alarm_leads(self) -> list[float]:
        """The same for the prediction of stick-slip [s]."""
        return [e.alarm_lead for e in self.episodes if e.alarm_lead is not None]

    @property
    def false_claims(self) -> list[WarningInterval]:
        """Warnings and alarms that claim what was never true."""
        return [claim for claim in (*self.warnings, *self.alarms) if claim.holds is False]

    @property
    def false_per_hour(self) -> float:
        """False warnings and alarms per hour; 0 where no time was judged."""
        return len(self.false_claims) * 3600.0 / self.seconds if self.seconds > 0.0 else 0.0

    @property
    def wrong(self) -> float:
        """Time in the wrong state: stick-slip predicted and absent, or the other way round [s]."""
        return self.unpredicted + self.overpredicted

    @property
    def is_good(self) -> bool:
        """Whether every episode was warned of in time, and no warning was false."""
        return not (self.missed or self.late or self.false_claims)


def score_bearing(
    alarm: AlarmConfig, events: Sequence[Event], span: Interval, truth: Truth
) -> Score:
    """Judge the events of one bearing.

    Args:
        alarm: The alarm's settings: its caution band, and how late it may be.
        events: The monitor's events, in order of time.
        span: First and last instant of the recording on the same clock [ns].
        truth: The truth.
    """
    window = (max(span[0], truth.start_ns), min(span[1], truth.end_ns))
    said = list(_said(events, window))
    warned, predicted = _at_least(said, _CAUTION), _at_least(said, _STICK_SLIP)
    blind = merged((start, end) for start, end, _, lost in said if lost)
    sticking = intersection(merged(truth.episodes), [window])
    both = seconds(intersection(sticking, predicted))
    judge = _Judge(alarm, truth, sticking)
    return Score(
        seconds=max(0.0, (window[1] - window[0]) / 1e9),
        episodes=tuple(_episode(e, warned, predicted, blind) for e in sticking),
        warnings=tuple(judge.claim(s, _highest(said, s, _BISTABLE)) for s in warned),
        alarms=tuple(judge.claim(s, _highest(said, s, len(LADDER))) for s in predicted),
        sticking=seconds(sticking),
        unpredicted=seconds(sticking) - both,
        unwarned=seconds(sticking) - seconds(intersection(sticking, warned)),
        overpredicted=seconds(predicted) - both,
        blind=seconds(blind),
    )


def in_total(scores: Iterable[Score]) -> Score:
    """Several judgements as one."""
    every = list(scores)
    return Score(
        seconds=sum(s.seconds for s in every),
        episodes=tuple(e for s in every for e in s.episodes),
        warnings=tuple(w for s in every for w in s.warnings),
        alarms=tuple(a for s in every for a in s.alarms),
        sticking=sum(s.sticking for s in every),
        unpredicted=sum(s.unpredicted for s in every),
        unwarned=sum(s.unwarned for s in every),
        overpredicted=sum(s.overpredicted for s in every),
        blind=sum(s.blind for s in every),
    )


def _said(events: Sequence[Event], window: Interval) -> Iterator[tuple[int, int, int, bool]]:
    """Start, end, rung and whether an input was lost, of each spell of the alarm."""
    rung = 0
    for spell in condition_intervals(events, *window):
        lost = spell.condition is Condition.INPUT_STALE
        rung = rung if lost else LADDER.index(spell.condition)
        start, end = max(spell.start_ns, window[0]), min(spell.end_ns, window[1])
        if start < end:
            yield start, end, rung, lost


def _at_least(said: Iterable[tuple[int, int, int, bool]], rung: int) -> list[Interval]:
    return merged((start, end) for start, end, own, _ in said if own >= rung)


def _highest(
    said: Iterable[tuple[int, int, int, bool]], stretch: Interval, most: int
) -> Condition:
    """The worst condition within a stretch, but no worse than a rung."""
    rungs = [rung for start, end, rung, _ in said if stretch[0] <= start and end <= stretch[1]]
    return LADDER[min(max(rungs), most)]


def _episode(
    episode: Interval, warned: Intervals, predicted: Intervals, blind: Intervals
) -> EpisodeScore:
    first, last = episode
    return EpisodeScore(
        first_ns=first,
        last_ns=last,
        lead=lead_of(episode, warned),
        alarm_lead=lead_of(episode, predicted),
        blind=any(start <= first < end for start, end in blind),
    )


def lead_of(episode: Interval, stretches: Intervals) -> float | None:
    """The lead of an episode [s]; ``None`` where it was missed.

    It is the time from the first stretch that reaches into an episode to the episode's begin.
    """
    for start, end in stretches:
        if start < episode[1] and end > episode[0]:
            return (episode[0] - start) / 1e9
    return None


class _Judge:
    """Whether what a condition claims was true."""

    def __init__(self, alarm: AlarmConfig, truth: Truth, sticking: Intervals) -> None:
        self.truth, self.sticking = truth, sticking
        # The deadband belongs to the claim; a delay lets the claim come after its cause.
        self.band = alarm.caution_margin + alarm.hysteresis
        step = int(np.median(np.diff(truth.time_ns))) if truth.time_ns.size > 1 else 0
        self.slack_ns = alarm.on_delay_ns + step

    def claim(self, stretch: Interval, highest: Condition) -> WarningInterval:
        """A stretch with the worst of its conditions, judged."""
        reach = (stretch[0] - self.slack_ns, stretch[1])
        return WarningInterval(*stretch, highest, self._holds(reach, highest))

    def _holds(self, reach: Interval, highest: Condition) -> bool | None:
        if intersection(self.sticking, [reach]):
            return True
        low, high = np.searchsorted(self.truth.time_ns, reach)
        rung = LADDER.index(highest)
        if low == high:
            return False if rung >= _STICK_SLIP else None
        if rung >= _STICK_SLIP:
            return bool(np.min(self.truth.hopf_margin[low:high]) < 0.0)
        limit = 0.0 if rung == _BISTABLE else self.band
        return bool(np.min(self.truth.fold_margin[low:high]) < limit)
