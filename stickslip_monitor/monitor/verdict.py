# SPDX-License-Identifier: Apache-2.0
"""What the monitor says: a verdict on every operating point, an event on every change of alarm.

``s`` is the memory of a bearing and ``c`` its settings, as the rule takes them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from stickslip_monitor.monitor import rule
from stickslip_monitor.monitor.assessment import Assessment, Outcome, assess, fold_share
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.ladder import LADDER, MEASURED, Condition, Measured, Unknown
from stickslip_monitor.monitor.rule_state import NEVER, RuleSettings
from stickslip_monitor.monitor.signals import QUANTITIES
from stickslip_monitor.physics.belief import Belief
from stickslip_monitor.physics.cycle.cycles import exact_amplitude

Chances = tuple[float, float, float]
"""The probabilities that stick-slip can happen, that it starts by itself, and that it runs."""
DOUBT = 60.0
"""Predicted for so long without measured vibration, the parameters are in doubt [s]."""


@dataclass(frozen=True, slots=True)
class Standing:
    """What the alarm of a bearing rests on."""

    rung: int = 0  # of the ladder on which it stands
    sticking: bool = False  # stick-slip is predicted to run
    asked: int = 0  # the highest rung that the operating point by itself asks for
    growth: float = 0.0  # of a disturbance while stick-slip is not predicted [e-folds]
    delay: float = 0.0  # how long it must be asked for before that rung is raised [s]
    clears: float | None = None  # when the rung clears if the point stays [s]; None: held by it
    raised: int = 0  # 1 for a rung that is raised, 2 for one that is held because it came back
    known: bool = False  # it is known which state a bistable bearing is in
    measured: Measured | None = None  # what the level says; None where none is configured
    unseen: float = 0.0  # how long stick-slip has been predicted and not measured [s]
    heard: bool = False  # the level has risen where a cycle exists
    loud: bool = False  # the level is high where no stick-slip can exist

    @property
    def condition(self) -> Condition:
        """What the alarm says of the operating point."""
        return LADDER[self.rung]


QUIET = Standing()


def standing_of(s: Any, c: Any) -> Standing:
    """What the alarm rests on."""
    rung, wanted = rule.rung_of(s), (s.raised & ~s.asks) | (s.asks & ~s.raised)
    asked = int(wanted).bit_length()
    clears, raised = None, 0
    if rung:
        k = rung - 1
        raised = 1 if s.cleared[k] == NEVER else 2
        if s.asks & (1 << k):
            clears = max(0, rule.due(s, c, k) - s.count[k]) * 1e-9
    return Standing(
        rung=rung,
        sticking=bool(s.sticking),
        asked=asked,
        growth=0.0 if s.sticking else s.growth,
        delay=rule.due(s, c, asked - 1) * 1e-9 if asked > rung else 0.0,
        clears=clears,
        raised=raised,
        known=bool(s.known),
        measured=MEASURED[rule.measured_now(s, c)] if c.has_level else None,
        unseen=0.0 if s.unseen == NEVER else (s.now - s.unseen) * 1e-9,
        heard=bool(s.heard),
        loud=bool(c.has_level and s.vibrating == rule.VIBRATING and s.loud > rule.LOUD),
    )


def why_unknown(s: Any, c: Any) -> Unknown | None:
    """Why the level of a bearing says nothing; ``None`` where it does."""
    stamp = s.stamp[rule.LEVEL]
    if stamp == NEVER:
        return Unknown.NOTHING
    if abs(s.now - stamp) > c.timeout[rule.LEVEL]:
        return Unknown.LOST
    if stamp - s.moved > rule.STUCK:
        return Unknown.STUCK
    if s.loud > rule.LOUD:
        return Unknown.LOUD
    if rule.measured_now(s, c) != rule.UNKNOWN:
        return None
    learning = c.threshold != c.threshold and s.watched < rule.LEARNED
    return Unknown.ONE_MODE if learning else Unknown.SHORT


def lost_inputs(s: Any, c: Any, now: int) -> dict[str, float]:
    """The inputs whose values no longer stand at a time [ns], with their ages [s]."""
    found: dict[str, float] = {}
    if s.began == NEVER:
        return found
    for place, name in enumerate(QUANTITIES):
        came = s.came[place]
        begun = s.began if came == NEVER else came
        if now >= begun + rule.age_limit(s, c, place):
            found[name] = math.inf if came == NEVER else (now - came) / 1e9
    return found


def assessed(
    config: BearingConfig,
    settings: RuleSettings,
    speed: float,
    load: float,
    chances: Iterable[float],
) -> Assessment:
    """The models' assessment of a speed [m/s] and load [N], with the rule's probabilities."""
    point = assess(config.bearing, speed, load, config.belief, settings.boundaries)
    point.remember_chances(chances)
    return point


def size_cycle(config: BearingConfig, s: Any, many: bool = False) -> None:
    """Work out the amplitude of the exact cycle, into the memory ``s``; compiled if many are."""
    speed, load = rule.median_point(s)
    amplitude = exact_amplitude(config.bearing, float(speed), float(load), many)
    s.amplitude, s.sized = s.amplitude if math.isnan(amplitude) else amplitude, s.now


@dataclass(frozen=True)
class Verdict:
    """The state of one bearing after an operating point."""

    bearing: str
    time_ns: int  # the later of its two measurements
    standing: Standing
    judge: Callable[[], Assessment]  # makes the assessment, when it is first asked for
    speed: float = math.nan  # of the surface [m/s]
    load: float = math.nan  # [N]
    chances: Chances = (0.0, 0.0, 0.0)  # the first three of BELIEFS; of no matter without one

    @cached_property
    def assessment(self) -> Assessment:
        """The models' assessment of the operating point, of numbers."""
        return self.judge()


@dataclass(frozen=True, slots=True)
class Event:
    """One change of a bearing's alarm, or a new onset of stick-slip while it stands."""

    bearing: str
    time_ns: int  # when the change fell due
    before: Condition
    after: Condition
    assessment: Assessment | None  # the last one up to then
    sticking: bool  # stick-slip was predicted to run
    lost: dict[str, float]  # the inputs that are lost, with their ages [s]; inf: never received
    text: str  # what happened, for a person
    standing: Standing = QUIET
    says: str = ''  # what the condition says by itself, whatever came before
    measured: Measured | None = None  # None where no level is configured
    onset: bool = False  # stick-slip has begun, which is announced whatever stood before

    @property
    def raised(self) -> bool:
        """Whether matters got worse."""
        if Condition.INPUT_STALE in (self.before, self.after):
            return self.after is Condition.INPUT_STALE
        return self.onset or LADDER.index(self.after) > LADDER.index(self.before)


def event_of(
    config: BearingConfig,
    s: Any,
    c: Any,
    time_ns: int,
    change: tuple[Condition, Condition],
    point: Assessment | None,
    onset: bool = False,
) -> Event:
    """A change of alarm, from one condition to another, with what it rests on."""
    before, after = change
    standing = QUIET if s.point == NEVER else standing_of(s, c)
    lost = lost_inputs(s, c, time_ns) if s.lost else {}
    return Event(
        config.name,
        time_ns,
        before,
        after,
        point,
        standing.sticking,
        lost,
        describe(config, after, point, standing, lost, before),
        standing,
        describe(config, after, point, standing, lost),
        standing.measured,
        onset,
    )


def describe(
    config: BearingConfig,
    condition: Condition,
    point: Assessment | None,
    standing: Standing,
    lost: dict[str, float],
    before: Condition | None = None,
) -> str:
    """One or a few sentences: what it is, what to do, and where the bearing stands."""
    if lost:
        return f'{config.name}: {_lost_text(config, lost)}'
    if point is None or condition is Condition.INPUT_STALE:
        return f'{config.name}: {condition.sentence}'
    what = _what(config, standing, point)
    if before is Condition.INPUT_STALE:
        what = f'Speed and load are back. {what}'
    elif before is Condition.AMPLITUDE and condition is Condition.STICK_SLIP:
        what = f'Amplitude back below the limit. {what}'
    out = _way_out(config, standing, point)
    at = f'{_speed_text(config, point, abs(point.speed))}, {_three(point.load / 1e3)} kN'
    text = f'{config.name}: {what}{out} Now {at}'
    if point.outcome in (Outcome.NO_CONTACT, Outcome.AT_REST, Outcome.NO_BOUNDARY):
        return f'{text}. {point.outcome.sentence}'
    if standing.sticking and math.isfinite(point.amplitude_exact):
        text += f', amplitude {_three(point.amplitude_exact * 1e3)} mm'
    text += f', fold margin {point.stability_margin:+.0%}.'
    return text + _belief_text(config, standing, point) + _doubt_text(standing)


_OVER = {
    Condition.VIBRATION: 'No more vibration that the model does not explain',
    Condition.CAUTION: 'Clear of the stick-slip region',
    Condition.BISTABLE: 'Out of the bistable range',
    Condition.STICK_SLIP: 'Stick-slip no longer predicted',
    Condition.AMPLITUDE: 'Amplitude back below the limit',
}


def _what(config: BearingConfig, standing: Standing, point: Assessment) -> str:
    """What the alarm says, and what is about to change."""
    condition, asked = standing.condition, LADDER[standing.asked]
    if standing.clears is not None:
        held = ' It came back within a minute and is held.' if standing.raised > 1 else ''
        return (
            f'{_OVER[condition]}: {condition} clears in {about(max(standing.clears, 1.0))}.{held}'
        )
    if point.outcome is Outcome.STICK_SLIP and not standing.sticking:
        return 'Steady sliding is unstable: stick-slip is starting.'
    if standing.sticking and standing.measured is Measured.VIBRATING:
        return _measured_text(point)
    if standing.asked > standing.rung:
        return f'{asked.sentence[:-1]} for less than {standing.delay:.3g} s: no alarm yet.'
    if condition is Condition.CAUTION and point.stability_margin > _caution_margin(config):
        return 'Slowing towards stick-slip.'
    if condition is Condition.BISTABLE:
        return f'{condition.sentence} {_state_text(standing)}'
    return condition.sentence


def _caution_margin(config: BearingConfig) -> float:
    return config.alarm.caution_margin + config.alarm.hysteresis


def _state_text(standing: Standing) -> str:
    """Whether a bistable bearing is quiet: measured, remembered, or not known."""
    if standing.measured is Measured.QUIET and standing.heard:
        return Measured.QUIET.sentence
    return 'Quiet by its history.' if standing.known else 'Whether it vibrates is not known.'


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
    if standing.loud:
        return f' {Unknown.LOUD.sentence[0].upper()}{Unknown.LOUD.sentence[1:]}.'
    quiet = standing.measured is Measured.QUIET
    if not (standing.sticking and quiet) or standing.unseen < DOUBT:
        return ''
    asks = (
        ': are the parameters and the threshold of the level right?'
        if standing.heard
        else '; the level has never risen in stick-slip: can it hear the bearing?'
    )
    return f' No vibration has been measured for {about(standing.unseen)}{asks}'


def _belief_text(config: BearingConfig, standing: Standing, point: Assessment) -> str:
    if config.belief is None or not math.isfinite(point.probability_can):
        return ''
    # The probability follows the load by a lag: it may not know yet of what runs already.
    if standing.sticking and point.probability_can < config.alarm.can_probability:
        return ''
    low, high = (config.belief.fold_speed(float(point.load), p) for p in (0.05, 0.95))
    # By averaging; the fold that decides may be the exact model's.
    rpm = config.bearing.speed.factor('rpm') * fold_share(point)
    return (
        f' Stick-slip is possible with {point.probability_can:.0%}: fold'
        f' {low / rpm:.3g} to {high / rpm:.3g} rpm at this load.'
    )


def _lost_text(config: BearingConfig, lost: dict[str, float]) -> str:
    return ' '.join(
        f'Input {name} lost: no valid value on {config.inputs[name].topic}'
        + (' so far.' if math.isinf(age) else f' for {age:.3g} s.')
        for name, age in lost.items()
    )


def _speed_text(config: BearingConfig, point: Assessment, speed: float) -> str:
    """A magnitude of the surface speed, in the direction in which the shaft turns."""
    rpm = float(config.bearing.speed.from_surface(speed, 'rpm'))
    return f'{_three(rpm)} rpm' + (' astern' if point.speed < 0.0 else '')


def _three(number: float) -> str:
    """A number to three digits, without an exponent where it is of usual size."""
    text = f'{number:.3g}'
    return f'{float(text):g}' if 'e' in text and abs(number) < 1e6 else text


def about(seconds: float) -> str:
    """A time to a precision that matters."""
    if seconds < 20.0:
        return f'{seconds:.0f} s'
    if seconds < 100.0:
        return f'{5.0 * round(seconds / 5.0):.0f} s'
    return f'{seconds / 60.0:.1f} min'


def _way_out(config: BearingConfig, standing: Standing, point: Assessment) -> str:
    """What leads out of the condition: out of the bistable range, and clear of caution."""
    condition = standing.condition
    if standing.asked > standing.rung or condition in (Condition.NORMAL, Condition.VIBRATION):
        # The text is about what is not raised yet, or of what no speed ends.
        return ''
    if config.belief is not None:
        return _way_out_by_belief(config, config.belief, condition, point)
    limit = point.stability_limit
    clear = limit * (1.0 + _caution_margin(config))
    if not math.isfinite(limit) or abs(point.speed) > clear:
        return ''
    if condition is Condition.CAUTION:
        return f' Clears above {_speed_text(config, point, clear)}.'
    to_be_clear = _speed_text(config, point, clear)
    return f' Go above {_speed_text(config, point, limit)} ({to_be_clear} to be clear) or stop.'


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
    limit = rule.LEFT_BELOW * limits.get(condition, 0.0)
    if not 0.0 < limit < point.probability_can:
        return ''
    speed = belief.fold_speed(float(point.load), 1.0 - limit) / fold_share(point)
    return f' Clears above {_speed_text(config, point, speed)}.'


def warns(config: BearingConfig, point: Assessment) -> bool:
    """Whether an operating point by itself, of numbers, asks for caution or worse."""
    if point.outcome in (Outcome.NO_CONTACT, Outcome.AT_REST, Outcome.NOT_FINITE):
        return False
    if point.has_belief:
        return bool(point.probability_can > config.alarm.caution_probability)
    return bool(point.stability_margin < config.alarm.caution_margin)
