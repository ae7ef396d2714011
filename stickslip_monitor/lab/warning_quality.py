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
- *far*: warnings that are raised and cleared while the true fold margin is at least 0.4.
- *burst*: the most raised conditions in ten minutes.
- *forecast*: whether the time until the Hopf speed is right within a factor of two, and whether
  its interval covers it.

All of it is a pure comparison of intervals.
"""

from __future__ import annotations

import math
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
        raised: When a condition got worse [ns].
        changes: Changes of condition.
    """

    warned: Intervals
    alarmed: Intervals
    raised: Sequence[int]
    changes: int


@dataclass(frozen=True, slots=True)
class Forecast:
    """A forecast that was told.

    Attributes:
        time_ns: When [ns].
        seconds: Time until steady sliding turns unstable [s].
        earliest: The least that its interval allows [s].
        latest: The most [s].
    """

    time_ns: int
    seconds: float
    earliest: float
    latest: float


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
        far_seconds: Time far from the boundary [s].
        far_warnings: Warnings in it.
        changes: Changes of condition.
        bursts: Of each voyage the most raised conditions in ten minutes.
        forecasts: Forecasts whose outcome is known.
        right: Those within a factor of two.
        covered: Those whose interval holds what happened.
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
    far_seconds: float = 0.0
    far_warnings: int = 0
    changes: int = 0
    bursts: tuple[int, ...] = ()
    forecasts: int = 0
    right: int = 0
    covered: int = 0
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
            'far_hours': self.far_seconds / 3600.0,
            'far_per_1000h': _ratio(self.far_warnings * 3_600_000.0, self.far_seconds),
            'changes_per_hour': _ratio(self.changes * 3600.0, self.seconds),
            'largest_burst': max(self.bursts, default=None),
            'bursts': sum(burst > MANY for burst in self.bursts),
            'wrong_source': self.wrong_source,
            'forecasts': self.forecasts,
            'forecast_right': _ratio(self.right, self.forecasts),
            'forecast_covered': _ratio(self.covered, self.forecasts),
        }


def _ratio(part: float, whole: float) -> float | None:
    return part / whole if whole else None


def pooled(parts: Iterable[Quality]) -> Quality:
    """Several together, added in their order."""
    return sum(parts, Quality())


def quality_of(
    said: Said, truth: Truth, plain: bool, forecasts: Sequence[Forecast] = ()
) -> Quality:
    """Judge one rule over one voyage.

    Args:
        said: What the rule said, within the time of the truth.
        truth: What the lining did, and the true margins.
        plain: Whether the voyage is one without knocks, wear and waves.
        forecasts: The forecasts that were told.
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
    known = [outcome for f in forecasts if (outcome := _outcome(f, truth)) is not None]
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
        far_seconds=seconds(far),
        far_warnings=sum(_inside(warning, far) for warning in warned),
        changes=said.changes,
        bursts=(largest_burst(said.raised),),
        forecasts=len(known),
        right=sum(right for right, _ in known),
        covered=sum(covered for _, covered in known),
    )


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


def _outcome(forecast: Forecast, truth: Truth) -> tuple[bool, bool] | None:
    """Whether a forecast was right and whether its interval held; ``None``: nobody knows."""
    margin = -truth.hopf_margin
    first = int(np.searchsorted(truth.time_ns, forecast.time_ns))
    crossed = np.flatnonzero(margin[first:] > 0.0)
    if crossed.size:
        actual = (_crossing(truth, margin, first + int(crossed[0])) - forecast.time_ns) / 1e9
    elif (truth.end_ns - forecast.time_ns) / 1e9 > max(2.0 * forecast.seconds, forecast.latest):
        actual = math.inf
    else:
        return None
    right = 0.5 * actual <= forecast.seconds <= 2.0 * actual
    # Texts give whole seconds.
    return right, forecast.earliest - 0.5 <= actual <= forecast.latest + 0.5


def _crossing(truth: Truth, margin: NDArray[np.float64], k: int) -> float:
    """When a margin that is above zero from sample ``k`` on passed it [ns], by a straight line."""
    if k == 0 or not math.isfinite(margin[k - 1]) or margin[k - 1] > 0.0:
        return float(truth.time_ns[k])
    share = margin[k] / (margin[k] - margin[k - 1])
    return float(truth.time_ns[k] - share * (truth.time_ns[k] - truth.time_ns[k - 1]))
