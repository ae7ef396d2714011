# SPDX-License-Identifier: Apache-2.0
"""What the monitor says: a verdict on every operating point, an event on every change of alarm."""

from __future__ import annotations

import math
from dataclasses import dataclass

from stickslip_monitor.monitor.assessment import Assessment, Outcome, fold_share
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.decision import LEFT_BELOW, ONSET, QUIET, Standing, near_fold
from stickslip_monitor.monitor.ladder import LADDER, Condition, ConditionChange
from stickslip_monitor.monitor.measured import Measured
from stickslip_monitor.monitor.trend import Trend
from stickslip_monitor.physics.belief import Belief

DOUBT = 60.0
"""Predicted for so long without measured vibration, the parameters are in doubt [s]."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """The state of one bearing after an evaluation.

    Attributes:
        bearing: Name of the bearing.
        time_ns: Time of the operating point: the later of its two measurements [ns].
        assessment: The averaged model's assessment, of scalars.
        standing: What the alarm rests on.
    """

    bearing: str
    time_ns: int
    assessment: Assessment
    standing: Standing

    @property
    def sticking(self) -> bool:
        """Whether stick-slip is predicted to run."""
        return self.standing.sticking

    @property
    def condition(self) -> Condition:
        """What the alarm says."""
        return self.standing.condition


@dataclass(frozen=True, slots=True)
class Event:
    """One change of a bearing's alarm.

    Attributes:
        bearing: Name of the bearing.
        time_ns: When the change fell due [ns].
        before: The condition before.
        after: The condition from then on.
        assessment: The last assessment up to then; ``None`` where there was none yet.
        sticking: Whether stick-slip was predicted to run.
        lost: The inputs that are lost, with their ages [s]; ``inf`` for one never received.
        text: What happened, for a person.
        standing: What the alarm rested on.
        says: What the condition says by itself, whatever came before.
        measured: What the measured vibration said; ``None`` where none is configured.
    """

    bearing: str
    time_ns: int
    before: Condition
    after: Condition
    assessment: Assessment | None
    sticking: bool
    lost: dict[str, float]
    text: str
    standing: Standing = QUIET
    says: str = ''
    measured: Measured | None = None

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
    standing: Standing,
    trend: Trend | None = None,
) -> Event:
    """A change of alarm with what it rests on."""
    before, after, lost = change.before, change.after, change.lost
    return Event(
        config.name,
        change.time_ns,
        before,
        after,
        assessment,
        standing.sticking,
        lost,
        describe(config, after, assessment, standing, lost, before, trend),
        standing,
        describe(config, after, assessment, standing, lost, None, trend),
        None if config.level is None else standing.measured or Measured.UNKNOWN,
    )


def describe(
    config: BearingConfig,
    condition: Condition,
    point: Assessment | None,
    standing: Standing,
    lost: dict[str, float],
    before: Condition | None = None,
    trend: Trend | None = None,
) -> str:
    """One or a few sentences: what, where, how bad, and what would leave the condition."""
    if lost:
        return f'{config.name}: {_lost_text(config, lost)}'
    if point is None or condition is Condition.INPUT_STALE:
        return f'{config.name}: {condition.sentence}'
    what = _what(config, standing, point)
    if before in _EASES and condition in _EASES[: _EASES.index(before)]:
        what = f'Eased from {before}. {what}'
    if before is Condition.INPUT_STALE:
        what = f'Speed and load are back. {what}'
    where = f'{config.name}: {what} At {_point_text(config, point)}'
    if point.outcome in (Outcome.NO_CONTACT, Outcome.AT_REST, Outcome.NO_BOUNDARY):
        return f'{where}. {point.outcome.sentence}{_trend_text(trend)}'
    if standing.sticking and math.isfinite(point.amplitude):
        where += f', predicted amplitude {point.amplitude * 1e3:.3g} mm'
    where += f', fold margin {point.stability_margin:+.1%}.{_way_out(config, standing, point)}'
    where += _belief_text(config, point) + _doubt_text(standing)
    return where + _trend_text(trend)


_EASES = LADDER[LADDER.index(Condition.CAUTION) :]
_OVER = {
    Condition.VIBRATION: 'No longer any vibration that the model does not explain',
    Condition.CAUTION: 'No longer close to the stick-slip region',
    Condition.BISTABLE: 'No longer inside the bistable range',
    Condition.STICK_SLIP: 'Stick-slip no longer predicted',
    Condition.AMPLITUDE: 'Stick-slip no longer predicted above the amplitude limit',
}


def _what(config: BearingConfig, standing: Standing, point: Assessment) -> str:
    """What the alarm says, what is about to change, and whether it fluctuates."""
    condition, asked = standing.condition, LADDER[standing.asked]
    if standing.clears is not None:
        what = f'{_OVER[condition]}: {condition} clears in {_about(max(standing.clears, 1.0))}.'
    elif point.outcome is Outcome.STICK_SLIP and not standing.sticking:
        what = f'Steady sliding is unstable: stick-slip is starting{_starting(standing, point)}.'
    elif standing.sticking and standing.measured is Measured.VIBRATING:
        what = _measured_text(point)
    elif standing.asked > standing.rung:
        delay = config.alarm.on_delay_ns * 1e-9
        what = f'{asked.sentence[:-1]}, but not yet for {delay:g} s.'
    elif condition is Condition.CAUTION and not near_fold(config.alarm, point)[0]:
        what = 'The speed is falling towards the stick-slip region.'
    else:
        what = condition.sentence
    if standing.raised > 1:
        what += f' Fluctuating across the boundary: raised {standing.raised} times lately.'
    return what


def _measured_text(point: Assessment) -> str:
    """Stick-slip that is measured: how it stands to what the model says."""
    if point.outcome is Outcome.STICK_SLIP:
        return 'Stick-slip predicted, and vibration is measured.'
    if point.stability_margin < 0.0:
        return 'Stick-slip: vibration is measured, and in the bistable range it goes on by itself.'
    return (
        'Stick-slip: vibration is measured, close outside the region in which the model expects'
        ' it: are the parameters right?'
    )


def _doubt_text(standing: Standing) -> str:
    if not standing.sticking or standing.unseen < DOUBT:
        return ''
    return (
        f' No vibration has been measured for {_about(standing.unseen)}, though stick-slip is'
        ' predicted: are the parameters and the threshold of the level right?'
    )


def _starting(standing: Standing, point: Assessment) -> str:
    """When a disturbance will have grown to the sliding limit."""
    rate = point.growth_rate
    left = (ONSET - standing.growth) / rate if rate > 0.0 else math.inf
    return f', in about {_about(max(left, 1.0))}' if left < 600.0 else ' slowly'


def _belief_text(config: BearingConfig, point: Assessment) -> str:
    if config.belief is None or not math.isfinite(point.probability_can):
        return ''
    low, high = (config.belief.fold_speed(float(point.load), p) for p in (0.05, 0.95))
    # By averaging; the fold that decides may be the exact model's.
    rpm = config.bearing.speed.factor('rpm') * fold_share(point)
    return (
        f' Stick-slip can happen with {point.probability_can:.0%}: fold'
        f' {low / rpm:.3g} to {high / rpm:.3g} rpm at this load.'
    )


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


def _trend_text(trend: Trend | None) -> str:
    if trend is None:
        return ''
    earliest, latest = _about(trend.earliest), _about(trend.latest)
    spread = f'{earliest} to {latest} at 90%, ' if earliest != latest else ''
    return (
        f' Steady sliding turns unstable in about {_about(trend.seconds)} at this rate'
        f' ({spread}judged by the last {trend.span:.0f} s).'
    )


def _about(seconds: float) -> str:
    if seconds < 20.0:
        return f'{seconds:.0f} s'
    if seconds < 100.0:
        return f'{5.0 * round(seconds / 5.0):.0f} s'
    return f'{seconds / 60.0:.1f} min'


def _way_out_by_belief(
    config: BearingConfig, belief: Belief, condition: Condition, point: Assessment
) -> str:
    alarm = config.alarm
    limits = {
        Condition.CAUTION: alarm.caution_probability,
        Condition.BISTABLE: alarm.can_probability,
        Condition.STICK_SLIP: alarm.runs_probability,
        Condition.AMPLITUDE: alarm.runs_probability,
    }
    limit = LEFT_BELOW * limits.get(condition, 0.0)
    if not 0.0 < limit < point.probability_can:
        return ''
    speed = belief.fold_speed(point.load, 1.0 - limit) / fold_share(point)
    return f' Ends above {_speed_text(config, point, speed)}.'


def _way_out(config: BearingConfig, standing: Standing, point: Assessment) -> str:
    condition = standing.condition
    if standing.asked > standing.rung:
        # The text is about what is not raised yet, and the way out would be of what stands.
        return ''
    if config.belief is not None:
        return _way_out_by_belief(config, config.belief, condition, point)
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
