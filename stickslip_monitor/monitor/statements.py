# SPDX-License-Identifier: Apache-2.0
"""What the monitor says: a verdict on every operating point, an event on every change of alarm.

Both come from the :class:`Standing` of a bearing, which reads its memory for people.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

from stickslip_monitor.monitor import rule
from stickslip_monitor.monitor.assessment import Assessment, Outcome, assess
from stickslip_monitor.monitor.parameters import BearingConfig
from stickslip_monitor.monitor.rule_settings import RuleSettings
from stickslip_monitor.monitor.rule_state import DOUBT, LEVEL, NEVER, WATER, State
from stickslip_monitor.monitor.sample_types import QUANTITIES
from stickslip_monitor.monitor.severity import (
    CONDITIONS,
    LADDER,
    MEASURED,
    Condition,
    Measured,
    Unknown,
    WordEnum,
)
from stickslip_monitor.monitor.vibration_rule import RISE, UNKNOWN, decibels, is_above_threshold, is_outdone
from stickslip_monitor.physics.cycles import exact_amplitude

UNSEEN = 60.0
"""Predicted for so long without measured vibration, the parameters are in doubt [s]."""


def size_cycle(config: BearingConfig, s: State) -> None:
    """Compute the amplitude of the exact cycle at the medians and store it in the memory, with its time.

    They are ``s.amplitude`` [m] and ``s.sized`` [ns]. Where no cycle exists the last amplitude stays.
    """
    speed, load = rule.median_point(s)
    bearing = config.bearing if config.water_temperature is None else config.bearing.at_temperature(s.water)
    amplitude = exact_amplitude(bearing, float(speed), float(load))
    s.amplitude, s.sized = s.amplitude if math.isnan(amplitude) else amplitude, s.now


@dataclass(frozen=True)
class Verdict:
    """The state of one bearing after an operating point."""

    bearing: str
    time_ns: int  # the later of its two measurements
    judge: Callable[[], Assessment]  # makes the assessment, when it is first asked for
    speed: float = math.nan  # of the surface [m/s]
    load: float = math.nan  # [N]
    chances: Sequence[float] = ()  # the first three of BELIEFS; of no matter without one
    measured: Measured | None = None  # what the level says; None where none is configured
    sticking: bool = False  # stick-slip is predicted to run

    @cached_property
    def assessment(self) -> Assessment:
        """The models' assessment of the operating point, of numbers."""
        return self.judge()


class Standing:
    """A bearing at an instant: what its memory means, for a person and for a record.

    Args:
        config: The bearing.
        settings: What the rule needs of the configuration.
        state: The memory, which is read when something is asked.
        verdict: The latest verdict; ``None`` before the first operating point.
    """

    def __init__(
        self, config: BearingConfig, settings: RuleSettings, state: State, verdict: Verdict | None = None
    ) -> None:
        self.config, self.settings, self.state, self.verdict = config, settings, state, verdict

    @property
    def condition(self) -> Condition:
        """Present condition."""
        return CONDITIONS[rule.condition_index(self.state)]

    @property
    def assessment(self) -> Assessment | None:
        """The models' assessment of the latest operating point, of numbers; ``None`` before the first."""
        return self.verdict.assessment if self.verdict else None

    @property
    def sticking(self) -> bool:
        """Whether stick-slip is predicted to run."""
        return bool(self.state.sticking)

    @property
    def growth(self) -> float:
        """Growth of a disturbance [e-folds]; 0 while stick-slip is predicted."""
        return 0.0 if self.state.sticking else float(self.state.growth)

    @property
    def rung(self) -> int:
        """Index in ``LADDER`` of the rung on which the alarm stands; 0 for normal."""
        return rule.rung_of(self.state)

    @property
    def asked_rung(self) -> int:
        """Index in ``LADDER`` of the highest rung that the operating point by itself asks for; 0 for none."""
        raised, asks = self.state.raised, self.state.asks
        return int((raised & ~asks) | (asks & ~raised)).bit_length()

    @property
    def raised_lately(self) -> int:
        """State of the worst raised rung: 0 for none, 1 raised, 2 raised again and held.

        It is held where it was raised within six off-delays of being cleared, a minute by default.
        """
        rung = self.rung
        if not rung:
            return 0
        return 1 if self.state.cleared[rung - 1] == NEVER else 2

    @property
    def clears_in(self) -> float | None:
        """Time until the rung clears if the point stays [s]; ``None`` where it is normal or lasts."""
        state, k = self.state, self.rung - 1
        if k < 0 or not state.asks & (1 << k):
            return None
        return max(0, rule.change_delay(state, self.settings.live, k) - state.count[k]) * 1e-9

    @property
    def measured(self) -> Measured | None:
        """Verdict of the measured vibration; ``None`` where none is configured."""
        settings = self.settings.live
        return MEASURED[rule.measured_now(self.state, settings)] if settings.has_level else None

    @property
    def unseen(self) -> float:
        """Time for which stick-slip has been predicted but measured as quiet [s]; 0 while it is not."""
        s = self.state
        return 0.0 if NEVER in (s.unseen, s.now) else (s.now - s.unseen) * 1e-9

    @property
    def is_loud(self) -> bool:
        """Whether the level is above its threshold but no higher than usual, without stick-slip."""
        s, c = self.state, self.settings.live
        high = rule.has_valid_level(s, c) and is_above_threshold(s, c, raised=False) and not s.sticking
        return high and decibels(c, s.level) < s.background + RISE

    @property
    def unknown(self) -> Unknown | None:
        """Reason why the measured vibration says nothing; ``None`` where it does or none is configured."""
        s, c = self.state, self.settings.live
        if not c.has_level:
            return None
        if s.came[LEVEL] == NEVER:
            return Unknown.NOTHING
        if not rule.has_valid_level(s, c):
            return Unknown.LOST
        if s.still > DOUBT:
            return Unknown.STUCK
        if self.is_loud or s.doubt > DOUBT:
            return Unknown.LOUD
        if rule.measured_now(s, c) != UNKNOWN:
            return None
        return Unknown.OTHER if is_outdone(s, c) else Unknown.SHORT

    @property
    def water_doubt(self) -> str:
        """Reason why the water may have another temperature, as a clause; empty where it is measured.

        Empty, too, where no sensor of it is configured.
        """
        source, came = self.config.water_temperature, self.state.came[WATER]
        if source is None:
            return ''
        if came == NEVER:
            is_known = not math.isnan(source.constant)
            return f'not measured yet, {"as configured" if is_known else "as where friction was measured"}'
        age = self.state.now - came
        if self.state.now == NEVER or age <= rule.age_limit(self.state, self.settings.live, WATER):
            return ''
        return f'not measured for {duration_text(age * 1e-9)}'

    def lost_ages(self, now: int | None = None) -> dict[str, float]:
        """Return the ages [s] of lost inputs, speed and load, by name; ``inf`` for one never received.

        It is empty where neither is lost, and before inputs are waited for.

        Args:
            now: A time on the memory's clock [ns]; ``None`` for the latest.
        """
        s, times = self.state, dict[str, float]()
        if s.began == NEVER:
            return times
        now = s.now if now is None else now
        for place, name in enumerate(QUANTITIES):
            came = s.came[place]
            begun = s.began if came == NEVER else came
            if now >= begun + rule.age_limit(s, self.settings.live, place):
                times[name] = math.inf if came == NEVER else (now - came) / 1e9
        return times

    def text(self) -> str:
        """Return the present message: sentences after the bearing's name, by :func:`describe`."""
        return describe(self, self.lost_ages() if self.state.lost else {})

    def judge(self, point: Sequence[float], measured: Measured | None = None) -> Verdict:
        """Set ``verdict`` to that on an operating point which the memory has taken already, and return it.

        Args:
            point: Speed [m/s], load [N], temperature of the water [C], and the first three probabilities of
                :data:`.BELIEFS`, which count with a belief only.
            measured: State of the level there; ``None`` where none is configured.
        """
        speed, load, water, *chances = point
        bearing, table = self.config.bearing, self.settings.boundaries
        own_water = None if self.config.water_temperature is None else water
        judge = partial(assess, bearing, speed, load, self.config.belief, table, chances, own_water)
        name = self.config.name, self.state.now - self.state.shift
        self.verdict = Verdict(*name, judge, speed, load, chances, measured, self.sticking)
        return self.verdict

    def advance(self, time_ns: int) -> list[Event]:
        """Let time pass in the memory without a sample, up to a time [ns] on the clock of the arrivals.

        The first call of all starts the wait for inputs; a time before the latest changes nothing.

        Returns:
            The event of an input that is lost by then, as a list of one, else an empty list.
        """
        state = self.state
        time_ns += state.shift
        if state.now != NEVER and time_ns < state.now:
            return []
        before, lost = rule.condition_index(state), state.lost
        rule.advance(state, self.settings.live, time_ns)
        return [self.event(before, state.lost_since)] if state.lost > lost else []

    def event(self, before: int, time_ns: int, *, onset: bool = False) -> Event:
        """Return the event that changed the condition, with a copy of the memory.

        Args:
            before: Index in ``CONDITIONS`` of the condition before.
            time_ns: When it changed, on the memory's clock [ns].
            onset: Whether stick-slip has begun with it.
        """
        then = Standing(self.config, self.settings, self.state.copy(), self.verdict)
        lost, was = then.lost_ages(time_ns) if then.state.lost else {}, CONDITIONS[before]
        return Event(time_ns - then.state.shift, was, then, lost, describe(then, lost, was), onset)


@dataclass(frozen=True)
class Event:
    """One change of a bearing's alarm, or a new onset of stick-slip while it stands."""

    time_ns: int  # when the change fell due
    before: Condition
    standing: Standing  # the bearing as it was then
    lost: dict[str, float]  # the inputs that are lost, with their ages [s]; inf: never received
    text: str  # what happened, for a person
    onset: bool = False  # stick-slip has begun, which is announced whatever stood before

    @property
    def bearing(self) -> str:
        """Its name."""
        return self.standing.config.name

    @property
    def after(self) -> Condition:
        """Condition after the event."""
        return self.standing.condition

    @cached_property
    def condition_text(self) -> str:
        """Text of the condition by itself, whatever came before."""
        return describe(self.standing, self.lost)

    @property
    def raised(self) -> bool:
        """Whether matters got worse: an input is lost, stick-slip began, or the condition is worse.

        Never where a lost input comes back.
        """
        if Condition.INPUT_STALE in (self.before, self.after):
            return self.after is Condition.INPUT_STALE
        return self.onset or LADDER.index(self.after) > LADDER.index(self.before)


def describe(b: Standing, lost: dict[str, float], before: Condition | None = None) -> str:
    """Return the text for a person: what the condition means, what to do, and the present point.

    It begins with the bearing's name. Without an assessment, or as input_stale, only the sentence of the
    condition follows.

    Args:
        b: The bearing.
        lost: The inputs lost, with their ages [s]; with any of them the text is about these alone.
        before: The condition before, where the text is about its change; else ``None``.
    """
    config, condition, point = b.config, b.condition, b.assessment
    if lost:
        return f'{config.name}: {_lost_text(config, lost)}'
    if point is None or condition is Condition.INPUT_STALE:
        return f'{config.name}: {condition.sentence}'
    given = speed_order(b)
    condition_text = _condition_text(b, point, given)
    if before is Condition.INPUT_STALE:
        condition_text = f'Speed and load are back. {condition_text}'
    elif before is Condition.AMPLITUDE and condition is Condition.STICK_SLIP:
        condition_text = f'Amplitude back below the limit. {condition_text}'
    assumed = f' ({config.load.origin})' if config.load.is_assumed else ''
    load = f'{rounded_text(point.load / 1e3)} kN{assumed}{_water_text(b, point)}'
    at = f'{_speed_text(config, point, abs(point.speed))}, {load}'
    text = f'{config.name}: {condition_text}{_order_text(given)} Now {at}'
    if point.outcome in (Outcome.NO_CONTACT, Outcome.AT_REST, Outcome.NO_BOUNDARY):
        return f'{text}. {point.outcome.sentence}'
    if point.outcome is Outcome.BELOW:
        ends = (_speed_text(config, point, v) for v in (point.lower_end, point.fold_speed))
        return f'{text}. {point.outcome.sentence} Stay below {" or go above ".join(ends)}.'
    if b.sticking and math.isfinite(point.amplitude_exact):
        text += f', amplitude {rounded_text(point.amplitude_exact * 1e3)} mm'
    margin = point.fold_margin
    text += f', {abs(margin) * 100.0:.0f} % {"below" if margin < 0.0 else "above"} the fold.'
    if b.state.raised & (1 << rule.VIBRATION) and condition is not Condition.VIBRATION:
        text += f' {Condition.VIBRATION.sentence}'
    return text + _belief_text(b, point) + _doubt_text(b)


def _water_text(b: Standing, point: Assessment) -> str:
    """Return the water's temperature as a clause, after a comma and a space, with any doubt about it.

    '' where friction does not depend on it, or where it is that of the measurement and not known.
    """
    lubrication = b.config.bearing.lubrication
    water = math.nan if lubrication is None else lubrication.water_temperature
    water = water if point.temperature is None else float(point.temperature)
    doubt = f' ({b.water_doubt})' if b.water_doubt else ''
    return '' if math.isnan(water) else f', water at {rounded_text(water)} C{doubt}'


_OVER = {
    Condition.VIBRATION: 'No more vibration that the model does not explain',
    Condition.CAUTION: 'Clear of the stick-slip region',
    Condition.BISTABLE: 'Out of the bistable range',
    Condition.STICK_SLIP: 'Stick-slip no longer predicted',
    Condition.AMPLITUDE: 'Amplitude back below the limit',
}


def _condition_text(b: Standing, point: Assessment, given: SpeedOrder | None) -> str:
    """Return the coming change, the order to stay above a speed, or else the meaning of the condition.

    The text is one or two sentences. ``given`` is the order to the crew; ``None`` where there is none.
    """
    condition, clears = b.condition, b.clears_in
    if clears is not None:
        held = ' It came back within a minute and is held.' if b.raised_lately > 1 else ''
        return f'{_OVER[condition]}: {condition} clears in {duration_text(max(clears, 1.0))}.{held}'
    if point.outcome is Outcome.AT_REST and condition is Condition.BISTABLE and not b.sticking:
        return 'The shaft is at rest: bistable is about to clear.'
    if _is_starting(b, point):
        return 'Steady sliding is unstable: stick-slip is starting.'
    if b.sticking and b.measured is Measured.VIBRATING:
        return _measured_text(point)
    # The alarm goes by medians: the latest values alone may be within the region already.
    rung = max(b.asked_rung, rule.CAUTION + 1 if calls_for_caution(b.config, point) else 0)
    if rung > b.rung:
        delay = rule.change_delay(b.state, b.settings.live, rung - 1) * 1e-9
        near = LADDER[rung].sentence.rstrip('.').partition(':')[0]
        return f'{near} for less than {delay:.3g} s: no alarm yet.'
    if given is not None and given.kind is OrderKind.STAY_ABOVE:
        return f'Slowing towards stick-slip: stay above {given.goal}.'
    return _bistable_text(b) if condition is Condition.BISTABLE else condition.sentence


def _bistable_text(b: Standing) -> str:
    """Return the sentence on a bistable bearing: vibrating, measured quiet, quiet so far, or not known."""
    if b.measured is Measured.VIBRATING:
        return 'Bistable: vibration is measured, and if it goes on it is stick-slip.'
    if b.measured is Measured.QUIET and b.state.heard:
        return 'Bistable: no vibration is measured, but a shock can start stick-slip.'
    if b.state.known:
        return 'Bistable: quiet so far, but a shock can start stick-slip.'
    return 'Bistable: a shock can start stick-slip. Vibration state unknown.'


def _measured_text(point: Assessment) -> str:
    """Return the sentence on stick-slip that is measured: whether the model expects it there."""
    if point.outcome is Outcome.STICK_SLIP:
        return 'Stick-slip predicted, and vibration is measured.'
    if point.fold_margin < 0.0:
        return 'Stick-slip: vibration is measured, and in the bistable range it goes on by itself.'
    return (
        'Stick-slip: vibration is measured, close outside the region in which the model expects'
        ' it: are the parameters right?'
    )


def _doubt_text(b: Standing) -> str:
    """Return a sentence, after a space, on a loud level, or one quiet in a minute of stick-slip; else ''."""
    if b.is_loud:
        return f' {Unknown.LOUD.sentence[0].upper()}{Unknown.LOUD.sentence[1:]}.'
    quiet = b.measured is Measured.QUIET
    if not (b.sticking and quiet) or b.unseen < UNSEEN:
        return ''
    asks = (
        ': are the parameters and the threshold of the level right?'
        if b.state.heard
        else '; the level has never risen in stick-slip: does its sensor reach the bearing?'
    )
    return f' No vibration has been measured for {duration_text(b.unseen)}{asks}'


def _belief_text(b: Standing, point: Assessment) -> str:
    """Return a sentence, after a space, with the probability of stick-slip and the range of the fold [rpm].

    The range is that from 5 to 95 %. '' without a belief, where the probability is not finite, and while
    stick-slip stands at a probability that has not followed the load yet.
    """
    config = b.config
    if config.belief is None or not math.isfinite(point.probability_can):
        return ''
    # The probability follows the load by a lag: it may not know yet of what runs already.
    if b.sticking and point.probability_can < config.alarm.can_probability:
        return ''
    scale = float(point.scale)
    low, high = (scale * config.belief.fold_speed(float(point.load) / scale, p) for p in (0.05, 0.95))
    # A belief is about the averaged fold, the share leads to the one that decides.
    rpm = config.bearing.speed.factor('rpm') * point.fold_share
    return (
        f' Stick-slip is possible with {point.probability_can:.0%}: fold'
        f' {low / rpm:.3g} to {high / rpm:.3g} rpm at this load.'
    )


def _lost_text(config: BearingConfig, lost: dict[str, float]) -> str:
    """Return a sentence for each lost input; ``lost`` has their ages [s], ``inf`` for one never received."""
    return ' '.join(
        f'Input {name} lost: no valid value on {config.inputs[name].topic}'
        + (' so far.' if math.isinf(age) else f' for {age_text(age)}.')
        for name, age in lost.items()
    )


def _speed_text(config: BearingConfig, point: Assessment, speed: float) -> str:
    """Return a magnitude of the surface speed [m/s] in rpm, with "astern" where the shaft turns so."""
    rpm = float(config.bearing.speed.from_surface(speed, 'rpm'))
    return f'{rounded_text(rpm)} rpm' + (' astern' if point.speed < 0.0 else '')


_YEAR = 31_557_600.0  # a Julian year [s]


def rounded_text(number: float, digits: int = 3) -> str:
    """Return a number as text in ``digits`` significant digits, without an exponent if it is below 1e9."""
    text = f'{number:.{digits}g}'
    return f'{float(text):.9g}' if 'e' in text and abs(number) < 1e9 else text


def age_text(seconds: float) -> str:
    """Return a finite age [s] as text: in three digits below 100 s, above as :func:`duration_text`."""
    return f'{seconds:.3g} s' if seconds < 99.5 else duration_text(seconds)


def duration_text(seconds: float) -> str:
    """Return a finite time >= 0 [s] as text in s, min, h, days or years, as precisely as matters."""
    if seconds < 20.0:
        return f'{seconds:.0f} s'
    if seconds < 100.0:
        return f'{5.0 * round(seconds / 5.0):.0f} s'
    if seconds < 7200.0:
        return f'{seconds / 60.0:.1f} min'
    if seconds < 172_800.0:
        return f'{seconds / 3600.0:.1f} h'
    return f'{seconds / 86_400.0:.0f} days' if seconds < 2.0 * _YEAR else f'{seconds / _YEAR:.1f} years'


class OrderKind(WordEnum):
    """Orders that a person can carry out for the condition of a bearing."""

    RAISE_SPEED = 'raise_speed'
    STAY_ABOVE = 'stay_above'
    CLEARS_ABOVE = 'clears_above'


@dataclass(frozen=True, slots=True)
class SpeedOrder:
    """The order that every way to a person gives: page, Signal K, NMEA and pager."""

    kind: OrderKind
    rpm: float  # the speed to reach, as it is given; negative astern

    @property
    def goal(self) -> str:
        """The speed to reach, for a person."""
        return f'{abs(self.rpm):.6g} rpm' + (' astern' if self.rpm < 0.0 else '')


def _is_starting(b: Standing, point: Assessment) -> bool:
    """Return whether steady sliding is unstable while a condition stands and no stick-slip is predicted."""
    return point.outcome is Outcome.STICK_SLIP and not b.sticking and b.condition is not Condition.NORMAL


def speed_order(b: Standing) -> SpeedOrder | None:
    """Return the order to the crew that leads out of the condition and clear of caution.

    ``None`` where the condition is normal, asks for no speed, or no speed ends it.
    """
    point, condition = b.assessment, b.condition
    if point is None or condition in (Condition.NORMAL, Condition.INPUT_STALE):
        return None
    is_starting = _is_starting(b, point)
    # Otherwise the text is about what is not raised yet, or of what no speed ends.
    if not is_starting and (b.asked_rung > b.rung or condition is Condition.VIBRATION):
        return None
    clear = _clear_speed(b, point)
    if point.outcome in (Outcome.BELOW, Outcome.AT_REST) or not math.isfinite(clear):
        return None
    if abs(point.speed) < clear:
        is_mild = condition is Condition.CAUTION and not is_starting
        kind = OrderKind.CLEARS_ABOVE if is_mild else OrderKind.RAISE_SPEED
    elif abs(point.speed) > clear and condition is Condition.CAUTION and b.clears_in is None:
        kind = OrderKind.STAY_ABOVE
    else:
        return None
    # As an order is given: rounded up to whole rpm, below 10 rpm to tenths.
    rpm = abs(float(b.config.bearing.speed.from_surface(clear, 'rpm')))
    step = 1.0 if rpm >= 10.0 else 0.1
    return SpeedOrder(kind, math.copysign(math.ceil(rpm / step) * step, point.speed))


def _order_text(given: SpeedOrder | None) -> str:
    """Return the order as a sentence after a space; '' for none, or to stay above a speed: that is said."""
    if given is None or given.kind is OrderKind.STAY_ABOVE:
        return ''
    if given.kind is OrderKind.CLEARS_ABOVE:
        return f' Clears above {given.goal}.'
    return f' Raise speed above {given.goal}, or stop the shaft.'


def _clear_speed(b: Standing, point: Assessment) -> float:
    """Return the speed above which caution clears at this load [m/s]; ``nan`` where none does."""
    alarm, belief = b.config.alarm, b.config.belief
    if belief is None or not b.config.alarms_by_chance or not math.isfinite(point.probability_can):
        return float(point.fold_speed) * (1.0 + alarm.caution_margin + alarm.hysteresis)
    if not 0.0 < alarm.caution_probability < 1.0:
        return math.nan
    scale = float(point.scale)
    fold = scale * float(belief.fold_speed(float(point.load) / scale, 1.0 - alarm.caution_probability))
    return fold / float(point.fold_share)


def calls_for_caution(config: BearingConfig, point: Assessment) -> bool:
    """Return whether an operating point by itself calls for caution or worse.

    By the probability of stick-slip where the bearing has tolerances and no calibration, else by the margin.
    False without contact, at rest, or where an input is not finite.
    """
    if point.outcome in (Outcome.NO_CONTACT, Outcome.AT_REST, Outcome.NOT_FINITE):
        return False
    if config.alarms_by_chance:
        return bool(point.probability_can > config.alarm.caution_probability)
    if point.outcome is Outcome.BELOW:
        return bool(abs(point.speed) * (1.0 + config.alarm.caution_margin) > point.lower_end)
    return bool(point.fold_margin < config.alarm.caution_margin)
