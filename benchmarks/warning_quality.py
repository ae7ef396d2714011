# SPDX-License-Identifier: Apache-2.0
"""How well warnings are given, by what the lining really did; a comparison of intervals.

The three figures of alarm systems are the rates of false and of missed alarms and the delay
(J. Xu, J. Wang, I. Izadi, T. Chen, IEEE Trans. Autom. Sci. Eng. 9(2), 2012, 296-307). Here:

- *warned*: a warning (caution or above) stands at an episode's first stick; *lead* is how long it
  has stood, negative where it came later; *missed*: none stands from the first to the last stick.
- *detected*: the stick-slip alarm stands at some time of the episode, with a lead of its own;
  *told*: before it, or within its first 5 s.
- *false*: a stick-slip alarm without an episode within 60 s; *baseless*: one of these while sliding
  was truly stable from its begin to its end, so no vibration could grow; *wrong* is the time in that
  alarm that is further than 60 s from every episode, *unfounded* that outside of episodes.
- *far*: warnings that are raised and cleared while the true fold margin is at least 0.4, and the
  time under a warning there.
- *newly given*: a warning is raised 10 s or more before an episode and after the one before;
  episodes within 60 s of one another are one bout. A warning that is only held adds nothing.
- *burst*: the most raised conditions in ten minutes; *sounds*: how often alarms begin to sound, or
  sound anew, if somebody acknowledges them once a minute; *unheard*: stick-slip that
  is predicted for 15 s without a sound, or an acknowledged alarm that stands.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from stickslip_lab.scenes.truth_topics import TruthRecord
from stickslip_monitor.arrays import BoolArray, IntArray

Interval = tuple[int, int]
Intervals = Sequence[Interval]
"""A set of time: sorted, disjoint, each with its begin and without its end [ns]."""

NEAR_NS = 60 * 10**9
"""An alarm this close to an episode belongs to it [ns]."""
FAR = 0.4
"""Least true fold margin at which a warning means nothing."""
BURST_NS = 600 * 10**9
MANY = 10
"""Raised conditions in ten minutes that are a burst."""
SOON = 5.0
"""An episode counts as announced in time if the alarm comes no later than this [s]."""
ENOUGH_LEAD = 10.0
"""A lead that leaves time to act [s]."""


def merge_intervals(intervals: Iterable[Interval]) -> list[Interval]:
    """Sort intervals, join those that overlap or touch, and drop the empty ones."""
    merged_intervals: list[Interval] = []
    for start, end in sorted(intervals):
        if end <= start:
            continue
        if merged_intervals and start <= merged_intervals[-1][1]:
            merged_intervals[-1] = (merged_intervals[-1][0], max(end, merged_intervals[-1][1]))
        else:
            merged_intervals.append((start, end))
    return merged_intervals


def intersect(first: Intervals, second: Intervals) -> list[Interval]:
    """Return the intersection of two sets of stretches."""
    common: list[Interval] = []
    i = k = 0
    while i < len(first) and k < len(second):
        start, end = max(first[i][0], second[k][0]), min(first[i][1], second[k][1])
        if start < end:
            common.append((start, end))
        if first[i][1] <= second[k][1]:
            i += 1
        else:
            k += 1
    return common


def seconds(intervals: Iterable[Interval]) -> float:
    """Return the length of a set [s]."""
    return sum(end - start for start, end in intervals) / 1e9


def while_true(time_ns: IntArray, state: BoolArray, end_ns: int) -> list[Interval]:
    """Return when a state that is known at some rising times [ns] was true; each holds to the next."""
    edge = np.flatnonzero(np.diff(np.concatenate([[False], state, [False]]).astype(np.int8)))
    ends = np.append(time_ns, end_ns)[edge]
    return merge_intervals(zip(ends[::2].tolist(), ends[1::2].tolist(), strict=True))


@dataclass(frozen=True, slots=True)
class RuleOutput:
    """Announcements of a rule over a voyage."""

    warned: Intervals  # when any warning was active
    alarmed: Intervals  # when its stick-slip alarm was active
    # When a condition got worse, or stick-slip began anew, rising [ns], and to which rung.
    raised: Sequence[tuple[int, int]]
    changes: int  # changes of condition
    sounds: Sequence[int] = ()  # when an alarm sounds, rising [ns]
    unheard: int = 0  # stretches of stick-slip of 15 s that do not, while no alarm stands acknowledged


@dataclass(frozen=True, slots=True)
class Episode:
    """Announcement of an episode of stick-slip: its sticks [ns], and leads [s] where any."""

    first_ns: int
    last_ns: int
    lead: float | None
    alarm_lead: float | None


def announced_episodes(output: RuleOutput, truth: TruthRecord) -> list[Episode]:
    """Return the episodes within the time of the truth, with their leads."""
    warned, alarmed, episodes = _clip_to_truth(truth, output.warned, output.alarmed, truth.episodes)
    return [Episode(*e, _lead_before(e, warned), _lead_before(e, alarmed)) for e in episodes]


def _clip_to_truth(truth: TruthRecord, *sets: Intervals) -> list[list[Interval]]:
    return [intersect(merge_intervals(s), [(truth.start_ns, truth.end_ns)]) for s in sets]


def _lead_before(episode: Interval, stretches: Intervals) -> float | None:
    """Return the time from the first interval that reaches into an episode to its begin [s]."""
    reach = (start for start, end in stretches if start < episode[1] and end > episode[0])
    return next(((episode[0] - start) / 1e9 for start in reach), None)


def false_alarms(output: RuleOutput, truth: TruthRecord) -> list[Interval]:
    """Return the stick-slip alarms without an episode within 60 s."""
    alarmed, episodes = _clip_to_truth(truth, output.alarmed, truth.episodes)
    near = _widen_episodes(episodes)
    return [alarm for alarm in alarmed if not intersect([alarm], near)]


def baseless_alarms(output: RuleOutput, truth: TruthRecord) -> list[Interval]:
    """Return the false alarms while sliding was truly stable from their begin to their end.

    Below the true Hopf speed a vibration grows: there the alarm says what is so, and stick-slip failed to
    come because the ship left that range sooner.
    """
    margin = truth.hopf_margin
    unstable = while_true(margin.time_ns, margin.value < 0.0, truth.end_ns)
    return [alarm for alarm in false_alarms(output, truth) if not intersect([alarm], unstable)]


def _widen_episodes(episodes: Intervals) -> list[Interval]:
    return merge_intervals((first - NEAR_NS, last + NEAR_NS) for first, last in episodes)


@dataclass(frozen=True, slots=True)
class Quality:
    """Sums over voyages, of which the rates are made."""

    seconds: float = 0.0  # time judged [s]
    leads: tuple[float, ...] = ()  # of each episode that was warned of, the lead [s]
    # The same for the stick-slip alarm, of each that was detected [s].
    alarm_leads: tuple[float, ...] = ()
    missed: int = 0  # episodes that were not warned of
    plain: int = 0  # episodes of voyages without knocks, wear and waves
    plain_detected: int = 0  # those of them that were detected
    false: int = 0  # false stick-slip alarms
    baseless: int = 0  # those of them while sliding was stable
    wrong: float = 0.0  # time in the stick-slip alarm far from every episode [s]
    unfounded: float = 0.0  # time in the stick-slip alarm without an episode [s]
    unalarmed: float = 0.0  # time in episodes without the stick-slip alarm [s]
    bouts: int = 0  # episodes, those within 60 s of one another as one
    newly: int = 0  # bouts before which a warning was newly given
    far_seconds: float = 0.0  # time far from the boundary [s]
    far_warnings: int = 0  # warnings in it
    far_warned: float = 0.0  # time under a warning in it [s]
    changes: int = 0  # changes of condition
    bursts: tuple[int, ...] = ()  # of each voyage the most raised conditions in ten minutes
    sounds: tuple[float, ...] = ()  # of each voyage, an hour
    loudest: tuple[int, ...] = ()  # of each voyage the most sounds in ten minutes
    unheard: int = 0  # stretches of stick-slip of 15 s without a sound
    wrong_source: int = 0  # voyages on which the source of an input was reported as wrong

    def __add__(self, addend: Quality) -> Quality:
        """Return the sum of both."""
        return Quality(**{f.name: getattr(self, f.name) + getattr(addend, f.name) for f in fields(Quality)})

    @property
    def episodes(self) -> int:
        """Episodes of stick-slip."""
        return len(self.leads) + self.missed

    @property
    def is_good(self) -> bool:
        """Whether every episode was warned of before its first stick, and no alarm was false."""
        return not (self.missed or self.false or any(lead < 0.0 for lead in self.leads))

    def figures(self) -> dict[str, float | None]:
        """Return the rates by name; a rate of nothing is ``None``."""
        return {name: rate(self) for name, (_, _, rate) in FIGURES.items()}


def pool_qualities(parts: Iterable[Quality]) -> Quality:
    """Return several qualities added in their order."""
    return sum(parts, Quality())


def _ratio_or_none(part: float, total: float) -> float | None:
    return part / total if total else None


def _quantile_or_none(leads: Sequence[float], level: float) -> float | None:
    return float(np.quantile(leads, level)) if leads else None


def _share_of_episodes(q: Quality, leads: Sequence[float], min_lead: float) -> float | None:
    return _ratio_or_none(sum(lead >= min_lead for lead in leads), q.episodes)


FIGURES: Mapping[str, tuple[str, str, Callable[[Quality], float | None]]] = {
    'hours': ('hours', '.2f', lambda q: q.seconds / 3600.0),
    'voyages': ('voyages', 'd', lambda q: len(q.bursts)),
    'episodes': ('episodes of stick-slip', 'd', lambda q: q.episodes),
    'warned': ('warned before onset', '.1%', lambda q: _share_of_episodes(q, q.leads, 0.0)),
    'lead_least': ('lead in s, least', '.1f', lambda q: min(q.leads, default=None)),
    'lead_p10': ('lead in s, lowest tenth', '.1f', lambda q: _quantile_or_none(q.leads, 0.1)),
    'lead_median': ('lead in s, median', '.1f', lambda q: _quantile_or_none(q.leads, 0.5)),
    'lead_10s': ('lead of 10 s or more', '.1%', lambda q: _share_of_episodes(q, q.leads, ENOUGH_LEAD)),
    'newly_given': ('a warning newly given 10 s before', '.1%', lambda q: _ratio_or_none(q.newly, q.bouts)),
    'missed': ('missed', '.1%', lambda q: _ratio_or_none(q.missed, q.episodes)),
    'detected': ('detected', '.1%', lambda q: _ratio_or_none(len(q.alarm_leads), q.episodes)),
    'told': ('detected within 5 s', '.1%', lambda q: _share_of_episodes(q, q.alarm_leads, -SOON)),
    'detected_plain': (
        'detected, without knocks, wear and waves',
        '.1%',
        lambda q: _ratio_or_none(q.plain_detected, q.plain),
    ),
    'alarm_least': ('lead of the alarm in s, least', '.1f', lambda q: min(q.alarm_leads, default=None)),
    'false_per_100h': (
        'false alarms per 100 h',
        '.1f',
        lambda q: _ratio_or_none(q.false * 360_000.0, q.seconds),
    ),
    'baseless_per_100h': (
        'of these, while sliding was stable',
        '.1f',
        lambda q: _ratio_or_none(q.baseless * 360_000.0, q.seconds),
    ),
    'wrong_hours': ('hours wrongly in alarm', '.2f', lambda q: q.wrong / 3600.0),
    'unfounded_hours': ('hours in stick-slip without an episode', '.2f', lambda q: q.unfounded / 3600.0),
    'unalarmed_hours': ('hours of episodes without the alarm', '.2f', lambda q: q.unalarmed / 3600.0),
    'far_hours': ('hours far from the boundary', '.1f', lambda q: q.far_seconds / 3600.0),
    'far_per_1000h': (
        'warnings per 1000 h there',
        '.1f',
        lambda q: _ratio_or_none(q.far_warnings * 3_600_000.0, q.far_seconds),
    ),
    'far_warned_hours': ('hours under a warning there', '.2f', lambda q: q.far_warned / 3600.0),
    'far_warned': (
        'share of the time under a warning there',
        '.1%',
        lambda q: _ratio_or_none(q.far_warned, q.far_seconds),
    ),
    'changes_per_hour': (
        'changes of condition an hour',
        '.1f',
        lambda q: _ratio_or_none(q.changes * 3600.0, q.seconds),
    ),
    'largest_burst': ('most raised conditions in 10 min', 'd', lambda q: max(q.bursts, default=None)),
    'bursts': ('voyages with more than 10 in 10 min', 'd', lambda q: sum(b > MANY for b in q.bursts)),
    'sounds': ('sounds an hour, median voyage', '.1f', lambda q: _quantile_or_none(q.sounds, 0.5)),
    'loudest': ('most sounds in 10 min', 'd', lambda q: max(q.loudest, default=None)),
    'unheard': ('stick-slip of 15 s without a sound', 'd', lambda q: q.unheard),
    'wrong_source': ('voyages with a wrong source reported', 'd', lambda q: q.wrong_source),
}
"""Each figure with what it is called, how it is written, and how it is made."""


def format_figure(name: str, value: float | None) -> str:
    """Return a figure as text; empty where there is none."""
    return '' if value is None else format(value, FIGURES[name][1])


def quality_of(output: RuleOutput, truth: TruthRecord, plain: bool) -> Quality:
    """Judge one rule over one voyage, which is plain without knocks, wear and waves."""
    warned, alarmed, episodes = _clip_to_truth(truth, output.warned, output.alarmed, truth.episodes)
    announcements = announced_episodes(output, truth)
    leads = tuple(e.lead for e in announcements if e.lead is not None)
    alarm_leads = tuple(e.alarm_lead for e in announcements if e.alarm_lead is not None)
    sticking_alarm_seconds = seconds(intersect(alarmed, episodes))
    margin = truth.fold_margin
    far = while_true(margin.time_ns, margin.value >= FAR, truth.end_ns)
    bouts, raised = _join_episodes(episodes), [time_ns for time_ns, _ in output.raised]
    return Quality(
        seconds=(truth.end_ns - truth.start_ns) / 1e9,
        leads=leads,
        alarm_leads=alarm_leads,
        missed=len(announcements) - len(leads),
        plain=len(announcements) if plain else 0,
        plain_detected=len(alarm_leads) if plain else 0,
        false=len(false_alarms(output, truth)),
        baseless=len(baseless_alarms(output, truth)),
        wrong=seconds(alarmed) - seconds(intersect(alarmed, _widen_episodes(episodes))),
        unfounded=seconds(alarmed) - sticking_alarm_seconds,
        unalarmed=seconds(episodes) - sticking_alarm_seconds,
        bouts=len(bouts),
        newly=_newly_given(bouts, raised),
        far_seconds=seconds(far),
        far_warnings=sum(intersect([warning], far) == [warning] for warning in warned),
        far_warned=seconds(intersect(warned, far)),
        changes=output.changes,
        bursts=(largest_burst(raised),),
        sounds=(len(output.sounds) * 3.6e12 / (truth.end_ns - truth.start_ns),),
        loudest=(largest_burst(output.sounds),),
        unheard=output.unheard,
    )


def _join_episodes(episodes: Intervals) -> list[Interval]:
    """Join episodes that follow one another within 60 s."""
    longer = merge_intervals((first, last + NEAR_NS - 1) for first, last in episodes)
    return [(first, last - NEAR_NS + 1) for first, last in longer]


def _newly_given(bouts: Intervals, raised: Sequence[int]) -> int:
    """Bouts before which a condition was raised in time, after the bout before."""
    latest_ns = round(ENOUGH_LEAD * 1e9)
    ends = [None, *(last for _, last in bouts)]
    return sum(
        any((end is None or end < time) and time <= first - latest_ns for time in raised)
        for (first, _), end in zip(bouts, ends, strict=False)
    )


def largest_burst(times_ns: Sequence[int]) -> int:
    """Return the largest number of rising times [ns] within ten minutes."""
    time = np.asarray(times_ns, dtype=np.int64)
    until = np.searchsorted(time, time + BURST_NS, side='left')
    return int(np.max(until - np.arange(time.size), initial=0))
