# SPDX-License-Identifier: Apache-2.0
"""What the monitor says: a verdict on every operating point, an event on every change of alarm."""

from __future__ import annotations

import math
from dataclasses import dataclass

from stickslip_monitor.monitor.assessment import Assessment, Outcome
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.ladder import LADDER, Condition, ConditionChange
from stickslip_monitor.monitor.trend import CONFIDENCE, Trend


@dataclass(frozen=True, slots=True)
class Verdict:
    """The state of one bearing after an evaluation.

    Attributes:
        bearing: Name of the bearing.
        time_ns: Time of the operating point: the later of its two measurements [ns].
        assessment: The averaged model's assessment, of scalars.
        sticking: Whether stick-slip is predicted, with the memory of the bistable range.
        condition: What the alarm says.
    """

    bearing: str
    time_ns: int
    assessment: Assessment
    sticking: bool
    condition: Condition


@dataclass(frozen=True, slots=True)
class Event:
    """One change of a bearing's alarm.

    Attributes:
        bearing: Name of the bearing.
        time_ns: When the change fell due [ns].
        before: The condition before.
        after: The condition from then on.
        assessment: The last assessment up to then; ``None`` where there was none yet.
        sticking: Whether that one predicted stick-slip.
        lost: The inputs that are lost, with their ages [s]; ``inf`` for one never received.
        text: What happened, for a person.
    """

    bearing: str
    time_ns: int
    before: Condition
    after: Condition
    assessment: Assessment | None
    sticking: bool
    lost: dict[str, float]
    text: str

    @property
    def raised(self) -> bool:
        """Whether matters got worse."""
        if Condition.INPUT_STALE in (self.before, self.after):
            return self.after is Condition.INPUT_STALE
        return LADDER.index(self.after) > LADDER.index(self.before)


def event_of(
    config: BearingConfig,
    change: ConditionChange,
    assessment: Assessment | None,
    sticking: bool,
    trend: Trend | None = None,
) -> Event:
    """A change of alarm with the assessment and the trend that it rests on."""
    text = describe(config, change.after, assessment, sticking, change.lost, change.before, trend)
    return Event(
        config.name,
        change.time_ns,
        change.before,
        change.after,
        assessment,
        sticking,
        change.lost,
        text,
    )


def describe(
    config: BearingConfig,
    condition: Condition,
    point: Assessment | None,
    sticking: bool,
    lost: dict[str, float],
    before: Condition | None = None,
    trend: Trend | None = None,
) -> str:
    """One or two sentences: what, where, how bad, and what would leave the condition."""
    if lost:
        return f'{config.name}: {_lost_text(config, lost)}'
    if point is None or condition is Condition.INPUT_STALE:
        return f'{config.name}: {condition.sentence}'
    eased = before in LADDER[2:] and condition in LADDER[1 : LADDER.index(before)]
    what = f'Eased from {before} to {condition}.' if eased else condition.sentence
    if before is Condition.INPUT_STALE:
        what = f'Speed and load are back. {what}'
    where = f'{config.name}: {what} At {_point_text(config, point)}'
    if point.outcome in (Outcome.NO_CONTACT, Outcome.AT_REST, Outcome.NO_BOUNDARY):
        return f'{where}. {point.outcome.sentence}{_trend_text(trend, sticking)}'
    if sticking:
        where += f', predicted amplitude {point.amplitude * 1e3:.3g} mm'
    where += f', fold margin {point.stability_margin:+.1%}.{_way_out(config, condition, point)}'
    return where + _trend_text(trend, sticking)


def _lost_text(config: BearingConfig, lost: dict[str, float]) -> str:
    inputs = {'speed': config.speed, 'load': config.load}
    return ' '.join(
        f'Input {name} lost: nothing believable on {inputs[name].topic}'
        + (' so far.' if math.isinf(age) else f' for {age:.3g} s.')
        for name, age in lost.items()
    )


def _point_text(config: BearingConfig, point: Assessment) -> str:
    return f'{_speed_text(config, point, abs(point.speed))} and {point.load / 1e3:.4g} kN'


def _speed_text(config: BearingConfig, point: Assessment, speed: float) -> str:
    """A magnitude of the surface speed, in the direction in which the shaft turns."""
    rpm = float(config.bearing.speed.from_surface(speed, 'rpm'))
    return f'{rpm:.4g} rpm' + (' astern' if point.speed < 0.0 else '')


def _trend_text(trend: Trend | None, sticking: bool) -> str:
    if trend is None:
        return ''
    what = 'Stick-slip would end' if sticking else 'Stick-slip'
    earliest, latest = _about(trend.earliest), _about(trend.latest)
    spread = f'{earliest} to {latest} at {CONFIDENCE:.0%}, ' if earliest != latest else ''
    return (
        f' {what} in about {_about(trend.seconds)} at this rate'
        f' ({spread}judged by the last {trend.span:.0f} s).'
    )


def _about(seconds: float) -> str:
    if seconds < 20.0:
        return f'{seconds:.0f} s'
    if seconds < 100.0:
        return f'{5.0 * round(seconds / 5.0):.0f} s'
    return f'{seconds / 60.0:.1f} min'


def _way_out(config: BearingConfig, condition: Condition, point: Assessment) -> str:
    if condition is Condition.NORMAL or not math.isfinite(point.stability_limit):
        return ''
    alarm, near = config.alarm, condition is Condition.CAUTION
    margin = alarm.caution_margin + alarm.hysteresis if near else 0.0
    if point.stability_margin > margin:
        return ''
    out = f' Ends above {_speed_text(config, point, point.stability_limit * (1.0 + margin))}'
    if not near and point.fold_load < point.load:
        out += f' or below {point.fold_load / 1e3:.4g} kN'
    return f'{out}.'
