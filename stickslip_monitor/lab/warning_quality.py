# SPDX-License-Identifier: Apache-2.0
"""How well warnings are given over many voyages: rates of misses, false alarms and delays.

The three figures of alarm systems are the rates of false and of missed alarms and the delay
(J. Xu, J. Wang, I. Izadi, T. Chen, IEEE Trans. Autom. Sci. Eng. 9(2), 2012, 296-307). Here:

- *warned*: a warning (caution or above) stands at an episode's first stick; *lead* is how long it
  has stood; *missed*: none stands from the first to the last stick.
- *detected*: the stick-slip alarm stands at some time of the episode; *told*: before it, or within
  its first 5 s.
- *false*: a stick-slip alarm without an episode within 60 s; *wrong* is the time in that alarm
  that is further than 60 s from every episode.
- *unfounded*: the time in that alarm without an episode.
- *far*: warnings that are raised and cleared while the true fold margin is at least 0.4, and the
  time under a warning there.
- *newly given*: a warning is raised 10 s or more before an episode and after the one before;
  episodes within 60 s of one another are one bout. A warning that is only held adds nothing.
- *burst*: the most raised conditions in ten minutes; *given*: the same of alarms that are given to
  people, a condition that comes back within 60 s of being given being the same alarm.

All of it is a pure comparison of intervals.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.lab.score import (
    Interval,
    Intervals,
    Truth,
    intersection,
    lead_of,
    merged,
    seconds,
)

NEAR_NS = 60 * 10**9
"""An alarm this close to an episode belongs to it [ns]."""
FAR = 0.4
"""Least true fold margin at which a warning means nothing."""
BURST_NS = 600 * 10**9
MANY = 10
"""Raised conditions in ten minutes that are a burst."""
SOON = 5.0
"""An episode is told if the alarm comes no later than this [s]."""
ENOUGH_LEAD = 10.0
"""A lead that leaves time to act [s]."""


@dataclass(frozen=True, slots=True)
class Said:
    """What a rule said over a voyage.

    Attributes:
        warned: When it warned of anything.
        alarmed: When it said that stick-slip runs.
        raised: When a condition got worse, or stick-slip began anew, rising [ns].
        given: When an alarm was given to people, rising [ns].
        changes: Changes of condition.
    """

    warned: Intervals
    alarmed: Intervals
    raised: Sequence[int]
    given: Sequence[int]
    changes: int


@dataclass(frozen=True, slots=True)
class Quality:
    """Sums over voyages, of which the rates are made.

    Attributes:
        seconds: Time judged [s].
        leads: Of each episode that was warned of, the lead [s]; negative where it came late.
        missed: Episodes that were not warned of.
        detected: Episodes that were detected.
        told: Those of them that were told within 5 s.
        plain: Episodes of voyages without knocks, wear and waves.
        plain_detected: Those of them that were detected.
        false: False stick-slip alarms.
        wrong: Time in the stick-slip alarm far from every episode [s].
        unfounded: Time in the stick-slip alarm without an episode [s].
        bouts: Episodes, those within 60 s of one another as one.
        newly: Bouts before which a warning was newly given.
        far_seconds: Time far from the boundary [s].
        far_warnings: Warnings in it.
        far_warned: Time under a warning in it [s].
        changes: Changes of condition.
        bursts: Of each voyage the most raised conditions in ten minutes.
        given: Of each voyage the most alarms given to people in ten minutes.
        wrong_source: Voyages on which the source of an input was told to be wrong.
    """

    seconds: float = 0.0
    leads: tuple[float, ...] = ()
    missed: int = 0
    detected: int = 0
    told: int = 0
    plain: int = 0
    plain_detected: int = 0
    false: int = 0
    wrong: float = 0.0
    unfounded: float = 0.0
    bouts: int = 0
    newly: int = 0
    far_seconds: float = 0.0
    far_warnings: int = 0
    far_warned: float = 0.0
    changes: int = 0
    bursts: tuple[int, ...] = ()
    given: tuple[int, ...] = ()
    wrong_source: int = 0

    def __add__(self, other: Quality) -> Quality:
        """Both together."""
        return Quality(
            **{f.name: getattr(self, f.name) + getattr(other, f.name) for f in fields(Quality)}
        )

    @property
    def episodes(self) -> int:
        """Episodes of stick-slip."""
        return len(self.leads) + self.missed

    def figures(self) -> dict[str, float | None]:
        """The rates by name; ``None`` where there was nothing to take one of."""
        leads = np.sort(self.leads)
        in_time = int(np.count_nonzero(leads >= 0.0))
        early = int(np.count_nonzero(leads >= ENOUGH_LEAD))
        return {
            'hours': self.seconds / 3600.0,
            'voyages': len(self.bursts),
            'episodes': self.episodes,
            'warned': _ratio(in_time, self.episodes),
            'lead_p10': float(np.quantile(leads, 0.1)) if leads.size else None,
            'lead_median': float(np.median(leads)) if leads.size else None,
            'lead_10s': _ratio(early, self.episodes),
            'missed': _ratio(self.missed, self.episodes),
            'detected': _ratio(self.detected, self.episodes),
            'told': _ratio(self.told, self.episodes),
            'detected_plain': _ratio(self.plain_detected, self.plain),
            'false_per_100h': _ratio(self.false * 360_000.0, self.seconds),
            'wrong_hours': self.wrong / 3600.0,
            'unfounded_hours': self.unfounded / 3600.0,
            'newly_given': _ratio(self.newly, self.bouts),
            'far_hours': self.far_seconds / 3600.0,
            'far_warned_hours': self.far_warned / 3600.0,
            'far_warned': _ratio(self.far_warned, self.far_seconds),
            'far_per_1000h': _ratio(self.far_warnings * 3_600_000.0, self.far_seconds),
            'changes_per_hour': _ratio(self.changes * 3600.0, self.seconds),
            'largest_burst': max(self.bursts, default=None),
            'bursts': sum(burst > MANY for burst in self.bursts),
            'largest_given': max(self.given, default=None),
            'wrong_source': self.wrong_source,
        }


def _ratio(part: float, whole: float) -> float | None:
    return part / whole if whole else None


def pooled(parts: Iterable[Quality]) -> Quality:
    """Several together, added in their order."""
    return sum(parts, Quality())


def quality_of(said: Said, truth: Truth, plain: bool) -> Quality:
    """Judge one rule over one voyage.

    Args:
        said: What the rule said, within the time of the truth.
        truth: What the lining did, and the true margins.
        plain: Whether the voyage is one without knocks, wear and waves.
    """
    window = [(truth.start_ns, truth.end_ns)]
    episodes = intersection(merged(truth.episodes), window)
    warned, alarmed = intersection(said.warned, window), intersection(said.alarmed, window)
    leads = [lead_of(episode, warned) for episode in episodes]
    alarms = [lead_of(episode, alarmed) for episode in episodes]
    detected = sum(lead is not None for lead in alarms)
    near = merged((first - NEAR_NS, last + NEAR_NS) for first, last in episodes)
    false = [alarm for alarm in alarmed if not intersection([alarm], near)]
    far = _far(truth)
    bouts = _bouts(episodes)
    return Quality(
        seconds=(truth.end_ns - truth.start_ns) / 1e9,
        leads=tuple(lead for lead in leads if lead is not None),
        missed=sum(lead is None for lead in leads),
        detected=detected,
        told=sum(lead is not None and lead >= -SOON for lead in alarms),
        plain=len(episodes) if plain else 0,
        plain_detected=detected if plain else 0,
        false=len(false),
        wrong=seconds(alarmed) - seconds(intersection(alarmed, near)),
        unfounded=seconds(alarmed) - seconds(intersection(alarmed, episodes)),
        bouts=len(bouts),
        newly=_newly_given(bouts, said.raised),
        far_seconds=seconds(far),
        far_warnings=sum(_inside(warning, far) for warning in warned),
        far_warned=seconds(intersection(warned, far)),
        changes=said.changes,
        bursts=(largest_burst(said.raised),),
        given=(largest_burst(said.given),),
    )


def _bouts(episodes: Intervals) -> list[Interval]:
    """Episodes, with those that follow one another within 60 s as one."""
    found: list[Interval] = []
    for first, last in episodes:
        if found and first - found[-1][1] < NEAR_NS:
            found[-1] = (found[-1][0], last)
        else:
            found.append((first, last))
    return found


def _newly_given(bouts: Intervals, raised: Sequence[int]) -> int:
    """Bouts before which a condition was raised in time, after the bout before."""
    latest_ns = round(ENOUGH_LEAD * 1e9)
    ends = [None, *(last for _, last in bouts)]
    return sum(
        any((end is None or end < time) and time <= first - latest_ns for time in raised)
        for (first, _), end in zip(bouts, ends, strict=False)
    )


def given_of(raised: Iterable[tuple[int, int]]) -> list[int]:
    """When alarms are given to people, of conditions raised with their rungs, rising [ns]."""
    last: dict[int, int] = {}
    found = []
    for time_ns, rung in raised:
        if rung not in last or time_ns - last[rung] > NEAR_NS:
            found.append(time_ns)
        last[rung] = time_ns
    return found


def largest_burst(times_ns: Sequence[int]) -> int:
    """The most of some rising times [ns] that fall within ten minutes."""
    time = np.asarray(times_ns, dtype=np.int64)
    until = np.searchsorted(time, time + BURST_NS, side='left')
    return int(np.max(until - np.arange(time.size), initial=0))


def _far(truth: Truth) -> list[Interval]:
    """When the operating point was far from the boundary, by the true margins."""
    return while_true(truth.time_ns, truth.fold_margin >= FAR, truth.end_ns)


def while_true(
    time_ns: NDArray[np.int64], state: NDArray[np.bool_], end_ns: int
) -> list[Interval]:
    """When a state that is known at some rising times [ns] was true; each holds to the next."""
    edge = np.flatnonzero(np.diff(np.concatenate([[False], state, [False]]).astype(np.int8)))
    ends = np.append(time_ns, end_ns)[edge]
    return merged(zip(ends[::2].tolist(), ends[1::2].tolist(), strict=True))


def _inside(interval: Interval, others: Intervals) -> bool:
    return any(start <= interval[0] and interval[1] <= end for start, end in others)
