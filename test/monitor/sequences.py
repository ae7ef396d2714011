# SPDX-License-Identifier: Apache-2.0
"""Random sequences of samples as a ship's sensors send them, with everything that goes wrong.

A sequence is made from its number alone, by the raw bits of PCG64 and the four operations of
arithmetic, so it is the same with every version of numpy and on every machine. The expected
changes of condition in ``golden.json.gz`` are kept by number.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor import MonitorConfig, Sample, build_config

SECOND = 10**9
NAME = 'b'
SPEED, LOAD, LEVEL = range(3)
QUANTITIES = ('speed', 'load', 'level')
COUNT = 240
"""How many sequences there are."""

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def _stribeck_parameters(static: float, kinetic: float, decay: float, viscous: float = 0.0) -> dict[str, Any]:
    return {
        'friction.static': static,
        'friction.kinetic': kinetic,
        'friction.decay': decay,
        'friction.viscous': viscous,
    }


def _body_parameters(mass: float, damping: float, stiffness: float, diameter: float) -> dict[str, Any]:
    return {'mass': mass, 'damping': damping, 'stiffness': stiffness, 'journal_diameter': diameter}


_TABLE = {
    'friction.law': 'tabulated',
    'friction.speed': (0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0),
    'friction.coefficient': (0.31, 0.27, 0.22, 0.16, 0.13, 0.11, 0.1, 0.1),
}
_COULOMB = {'friction.law': 'coulomb', 'friction.static': 0.2, 'friction.kinetic': 0.1}
BEARINGS: dict[str, tuple[dict[str, Any], float, float]] = {
    'reference': (_body_parameters(50.0, 400.0, 2e6, 0.1) | _stribeck_parameters(0.3, 0.1, 10.0), 40.7, 1e3),
    'ship': (
        _body_parameters(900.0, 4300.0, 1.28e7, 0.42) | _stribeck_parameters(0.26, 0.09, 5.0),
        22.2,
        3e4,
    ),
    'steep': (
        _body_parameters(120.0, 900.0, 3e6, 0.16) | _stribeck_parameters(0.34, 0.08, 30.0),
        25.2,
        2500.0,
    ),
    'viscous': (
        _body_parameters(250.0, 1500.0, 4e6, 0.25) | _stribeck_parameters(0.28, 0.1, 8.0, 0.01),
        22.4,
        6e3,
    ),
    'coulomb': (_body_parameters(70.0, 500.0, 1.5e6, 0.12) | _COULOMB, 30.0, 800.0),
    'table': (_body_parameters(44.0, 330.0, 2.2e6, 0.11) | _TABLE, 45.8, 900.0),
}
"""By name: parameters, fold speed (for a Coulomb law some speed) [rpm] and nominal load [N]."""
KINDS = (
    'plain',
    'noise',
    'odd_values',
    'gaps',
    'bursts',
    'copies',
    'odd_stamps',
    'late',
    'clock_jump',
    'stuck',
    'astern',
    'stops',
    'quantised',
    'two_publishers',
)
"""What can be special about a sequence; each has one of these and may have two more."""


class Bits:
    """Random numbers from the raw bits of PCG64."""

    def __init__(self, seed: int) -> None:
        self._bits = np.random.PCG64(seed)

    def uniform(self, size: int) -> Floats:
        """Numbers in [0, 1), shape (size,)."""
        return (self._bits.random_raw(size) >> np.uint64(11)).astype(np.float64) * 2.0**-53

    def between(self, low: float, high: float) -> float:
        """Return one number in [low, high)."""
        return low + (high - low) * float(self.uniform(1)[0])

    def below(self, limit: int) -> int:
        """Return a whole number from 0 to below a limit."""
        return int(self._bits.random_raw()) % limit

    def chance(self, share: float) -> bool:
        """True in this share of cases."""
        return bool(self.uniform(1)[0] < share)

    def pick(self, choices: Any) -> Any:
        """Return one of some choices."""
        return choices[self.below(len(choices))]

    def rough_normal(self, size: int) -> Floats:
        """Numbers of mean 0 and standard deviation 1: the sum of twelve uniform ones less six."""
        total = np.full(size, -6.0)
        for _ in range(12):
            total = total + self.uniform(size)
        return total


@dataclass(frozen=True, slots=True, eq=False)
class Messages:
    """Messages of one or more inputs, in order of arrival, shape (n,) each."""

    arrival_ns: Integers
    quantity: NDArray[np.int8]
    time_ns: Integers  # stamps
    value: Floats

    def __getitem__(self, rows: Any) -> Messages:
        """Return some of them."""
        columns = (self.arrival_ns, self.quantity, self.time_ns, self.value)
        return Messages(*(column[rows] for column in columns))


def _merge_messages(parts: list[Messages]) -> Messages:
    """Merge messages of several senders in order of arrival."""
    names = ('arrival_ns', 'quantity', 'time_ns', 'value')
    every = Messages(*(np.concatenate([getattr(p, name) for p in parts]) for name in names))
    return every[np.argsort(every.arrival_ns, kind='stable')]


@dataclass(frozen=True, slots=True, eq=False)
class Sequence:
    """A sequence of samples of one bearing, a key of :data:`BEARINGS`, in order of arrival."""

    number: int
    bearing: str
    kinds: tuple[str, ...]  # what is special about it, and ``level`` with a level
    parameters: dict[str, Any]
    messages: Messages
    start_ns: int | None  # when the waiting for inputs begins; None: with the first sample
    end_ns: int  # until when time passes after the last sample

    @property
    def config(self) -> MonitorConfig:
        """Return its configuration, of one bearing :data:`NAME`."""
        parameters = {f'{NAME}.{key}': value for key, value in self.parameters.items()}
        return build_config({'bearings': [NAME]} | parameters)

    def samples(self) -> Iterator[Sample]:
        """Yield the samples in order of arrival."""
        messages = self.messages
        columns = (messages.quantity, messages.time_ns, messages.value, messages.arrival_ns)
        for quantity, *sample in zip(*(c.tolist() for c in columns), strict=True):
            yield Sample(NAME, QUANTITIES[quantity], *sample)


def sequence(number: int) -> Sequence:
    """Make the sequence of a number."""
    bits = Bits(number)
    bearing = bits.pick(tuple(BEARINGS)) if number % 3 else 'reference'
    kinds = _pick_kinds(bits, number)
    rates = (bits.pick((0.2, 0.5, 1.0, 2.0, 5.0, 10.0)), bits.pick((0.2, 1.0, 5.0, 10.0)))
    if bits.chance(0.1):
        rates = (50.0, 50.0)
    seconds = min(1200.0, 500.0 / max(rates)) + bits.between(60.0, 120.0)
    ship = _Ship(bits, bearing, kinds, seconds)
    start = bits.pick((0, 1_700_000_000)) * SECOND
    parts = [_make_messages(bits, ship, kinds, k, rate, start) for k, rate in enumerate(rates)]
    parameters = _draw_parameters(bits, bearing, rates)
    if 'level' in kinds:
        parameters |= _level_parameters(bits)
        parts.append(_make_level(bits, ship, parameters, start))
    messages = _merge_messages(parts)
    if 'clock_jump' in kinds:
        messages = _step_clock(bits, messages)
    last = int(messages.arrival_ns[-1])
    return Sequence(
        number,
        bearing,
        kinds,
        parameters,
        messages,
        bits.pick((None, start, start - 20 * SECOND)),
        last + bits.pick((0, 1, 60)) * SECOND,
    )


def _pick_kinds(bits: Bits, number: int) -> tuple[str, ...]:
    kinds = [KINDS[number % len(KINDS)]]
    kinds += [bits.pick(KINDS) for _ in range(bits.below(3))]
    if bits.chance(0.4):
        kinds.append('level')
    return tuple(dict.fromkeys(kinds))


def _draw_parameters(bits: Bits, bearing: str, rates: tuple[float, float]) -> dict[str, Any]:
    parameters = dict(BEARINGS[bearing][0])
    parameters |= {'speed.topic': '/n', 'speed.unit': 'rpm', 'load.topic': '/f', 'load.unit': 'N'}
    for quantity, rate in zip(QUANTITIES, rates, strict=False):
        parameters[f'{quantity}.timeout'] = max(bits.pick((2.0, 5.0, 15.0)), 1.5 / rate)
    parameters['speed.maximum'] = 5.0
    parameters['load.maximum'] = 1e6
    parameters['alarm.minimum_speed'] = bits.pick((0.0, 0.003))
    if bits.chance(0.5):
        parameters['alarm.amplitude_limit'] = bits.pick((0.3e-3, 0.9e-3, 3e-3))
    if bits.chance(0.3):
        parameters['alarm.on_delay'] = bits.pick((0.0, 1.0, 4.0))
        parameters['alarm.off_delay'] = bits.pick((0.0, 5.0, 30.0))
    if bits.chance(0.2):
        parameters['alarm.onset_growth'] = bits.pick((0.0, 1.0, 2.0))
    if bits.chance(0.2):
        parameters['alarm.look_ahead'] = bits.pick((0.0, 60.0))
    if bits.chance(0.2):
        parameters['alarm.caution_margin'] = bits.pick((0.0, 0.1, 0.3))
    if bits.chance(0.2) and bearing in ('reference', 'ship', 'viscous'):
        parameters |= {f'tolerance.{k}': 0.05 for k in ('damping', 'static', 'decay', 'load')}
    return parameters


def _level_parameters(bits: Bits) -> dict[str, Any]:
    level: dict[str, Any] = {'level.topic': '/v', 'level.timeout': bits.pick((2.5, 5.0, 15.0))}
    kind = bits.pick(('threshold', 'threshold', 'learned', 'dB'))
    level['level.unit'] = 'dB' if kind == 'dB' else 'mm/s'
    if kind != 'learned':
        level['level.threshold'] = 30.0
    return level


class _Ship:
    """Speed and load of a shaft: multiples of fold speed and nominal load over time.

    Each is linear between some points, with a triangular wave on top of the load.
    """

    def __init__(self, bits: Bits, bearing: str, kinds: tuple[str, ...], seconds: float) -> None:
        _, self.fold, self.nominal = BEARINGS[bearing]
        self.seconds = seconds
        count = 4 + bits.below(8)
        at = np.sort(bits.uniform(count)) * seconds
        choices = [0.4, 0.5, 0.7, 0.8, 0.9, 0.95, 1.05, 1.1, 1.3, 1.5, 2.0]
        if 'stops' in kinds:
            choices += [0.0, 0.0, 0.0, 0.002]
        speed = np.array([bits.pick(choices) for _ in range(count)])
        if 'astern' in kinds:
            speed[bits.below(count) :] *= -1.0
        # A level stretch after each point, then a ramp.
        stay = at[:-1] + np.diff(at) * bits.pick((0.0, 0.5, 0.9))
        self._at = np.sort(np.concatenate([at, stay]))
        self._speed = np.repeat(speed, 2)[: self._at.size]
        self._load = np.array([bits.pick((0.7, 0.9, 1.0, 1.0, 1.1, 1.4)) for _ in self._at])
        self._wave = bits.pick((0.0, 0.0, 0.1, 0.4)), bits.between(4.0, 12.0)

    def speed(self, time: Floats) -> Floats:
        """Return multiples of the fold speed at some times [s]."""
        return _interpolate_linearly(time, self._at, self._speed)

    def load(self, time: Floats) -> Floats:
        """Return multiples of the nominal load at some times [s]."""
        height, period = self._wave
        phase = time / period - np.floor(time / period)
        wave = height * (np.abs(4.0 * phase - 2.0) - 1.0)
        return _interpolate_linearly(time, self._at, self._load) + wave


def _interpolate_linearly(time: Floats, at: Floats, value: Floats) -> Floats:
    """Interpolate linearly between points, constant outside them (numpy's own may round otherwise)."""
    k = np.clip(np.searchsorted(at, time, 'right') - 1, 0, at.size - 2)
    span = np.maximum(at[k + 1] - at[k], 1e-9)
    share = np.clip((time - at[k]) / span, 0.0, 1.0)
    return value[k] + share * (value[k + 1] - value[k])


def _sample_times(bits: Bits, rate: float, seconds: float) -> Floats:
    count = max(2, int(seconds * rate))
    jitter = bits.pick((0.0, 0.0, 0.2)) * bits.uniform(count)
    return (np.arange(count) + jitter + bits.between(0.0, 1.0)) / rate


def _to_nanoseconds(time: Floats, start_ns: int) -> Integers:
    return np.asarray(np.floor(time * 1e9), np.int64) + start_ns


def _make_messages(
    bits: Bits, ship: _Ship, kinds: tuple[str, ...], quantity: int, rate: float, start_ns: int
) -> Messages:
    """Make the messages of speed or load, with what is special about them."""
    time = _sample_times(bits, rate, ship.seconds)
    value = ship.speed(time) * ship.fold if quantity == SPEED else ship.load(time) * ship.nominal
    if 'noise' in kinds or bits.chance(0.3):
        spread = bits.pick((0.005, 0.02)) if quantity == SPEED else bits.pick((0.02, 0.05, 0.1))
        value = value * (1.0 + spread * bits.rough_normal(time.size))
    if 'quantised' in kinds:
        step = bits.pick((0.5, 1.0, 3.0)) if quantity == SPEED else ship.nominal * 0.05
        value = np.floor(value / step + 0.5) * step
    value = _odd_values(bits, ship, kinds, quantity, value)
    stamp = _to_nanoseconds(time, start_ns)
    sent = Messages(stamp, np.full(time.size, quantity, np.int8), stamp, value)
    for kind in kinds:
        change = _EFFECTS.get(kind)
        if change is not None and bits.chance(0.7):
            sent = change(bits, sent)
    if 'two_publishers' in kinds and quantity == SPEED:
        sent = _merge_messages([sent, _second_publisher(bits, ship, rate, start_ns)])
    return sent


def _odd_values(bits: Bits, ship: _Ship, kinds: tuple[str, ...], quantity: int, value: Floats) -> Floats:
    value = value.copy()
    if 'stuck' in kinds and bits.chance(0.6):
        first = bits.below(value.size)
        value[first : first + value.size // 3] = value[first]
    if 'odd_values' in kinds:
        usual = ship.fold if quantity == SPEED else ship.nominal
        extremes = np.array([np.nan, np.inf, -np.inf, 1e9, 0.0, 2.0 * usual, 0.4 * usual, -usual])
        rows = bits.uniform(value.size) < bits.pick((0.005, 0.03, 0.2))
        which = np.asarray(bits.uniform(value.size) * extremes.size, np.intp)
        value = np.where(rows, extremes[which], value)
    return value


def _make_gaps(bits: Bits, sent: Messages) -> Messages:
    """Leave out some stretches, from a second to a tenth of all."""
    is_kept = np.ones(sent.value.size, bool)
    span = int(sent.time_ns[-1] - sent.time_ns[0])
    for _ in range(1 + bits.below(4)):
        begin = int(sent.time_ns[0]) + int(span * bits.between(0.0, 1.0))
        lasting = int(bits.pick((1.5, 4.0, 10.0, 60.0)) * SECOND)
        is_kept &= (sent.time_ns < begin) | (sent.time_ns > begin + lasting)
    is_kept[:2] = True
    return sent[is_kept]


def _hold_back_bursts(bits: Bits, sent: Messages) -> Messages:
    """Hold messages back to the end of each second: stamped where they are made, or on arrival."""
    period = bits.pick((1, 1, 3)) * SECOND
    slot = sent.arrival_ns // period
    within = np.arange(slot.size) - np.searchsorted(slot, slot)
    arrival = (slot + 1) * period + within * bits.pick((0, 1_000_000, 2_000_000))
    stamp = sent.time_ns if bits.chance(0.4) else arrival
    return Messages(arrival, sent.quantity, stamp, sent.value)


def _send_copies(bits: Bits, sent: Messages) -> Messages:
    """Send some messages two or three times, with the same stamp or a little later."""
    times = 1 + np.asarray(bits.uniform(sent.value.size) * bits.pick((1.3, 3.0)), np.intp)
    rows = np.repeat(np.arange(times.size), times)
    copy = np.arange(rows.size) - np.searchsorted(rows, rows)
    sent, later = sent[rows], copy * bits.pick((0, 1_000_000, 4_000_000))
    return Messages(sent.arrival_ns + later, sent.quantity, sent.time_ns + later, sent.value)


def _odd_stamps(bits: Bits, sent: Messages) -> Messages:
    """Stamp some messages seconds or an hour off."""
    off = bits.pick((4.8, 6.0, 6.0, 40.0, 3600.0))
    rows = bits.uniform(sent.value.size) < bits.pick((0.01, 0.05, 0.2))
    sign = np.where(bits.uniform(sent.value.size) < bits.pick((0.0, 0.5, 1.0)), -1, 1)
    stamp = np.where(rows, sent.time_ns + sign * int(off * SECOND), sent.time_ns)
    return Messages(sent.arrival_ns, sent.quantity, stamp, sent.value)


def _delay_some(bits: Bits, sent: Messages) -> Messages:
    """Let some messages arrive late, out of order."""
    rows = bits.uniform(sent.value.size) < bits.pick((0.05, 0.3))
    delay = bits.uniform(sent.value.size) * bits.pick((0.2, 2.0, 8.0)) * 1e9
    arrival = sent.arrival_ns + np.where(rows, np.asarray(delay, np.int64), 0)
    changed = Messages(arrival, sent.quantity, sent.time_ns, sent.value)
    return changed[np.argsort(arrival, kind='stable')]


_EFFECTS = {
    'gaps': _make_gaps,
    'bursts': _hold_back_bursts,
    'copies': _send_copies,
    'odd_stamps': _odd_stamps,
    'late': _delay_some,
}


def _second_publisher(bits: Bits, ship: _Ship, rate: float, start_ns: int) -> Messages:
    """Make the messages of a second publisher of the speed, whose clock may be off."""
    time = _sample_times(bits, rate * bits.pick((0.3, 1.0)), ship.seconds * bits.between(0.3, 1.0))
    value = ship.speed(time) * ship.fold
    if bits.chance(0.5):
        value = np.full(time.size, 1.5 * ship.fold)
    arrival = _to_nanoseconds(time, start_ns)
    stamp = arrival + int(bits.pick((0.0, 0.3, -1.0, 7.0)) * SECOND)
    return Messages(arrival, np.zeros(time.size, np.int8), stamp, value)


def _step_clock(bits: Bits, every: Messages) -> Messages:
    """Set the clock of all stamps back or forward once or twice."""
    stamp = every.time_ns.copy()
    for _ in range(1 + bits.below(2)):
        first = bits.below(stamp.size)
        stamp[first:] += int(bits.pick((-600.0, -30.0, -7.0, 8.0, 3600.0)) * SECOND)
    return Messages(every.arrival_ns, every.quantity, stamp, every.value)


def _make_level(bits: Bits, ship: _Ship, parameters: dict[str, Any], start_ns: int) -> Messages:
    """Make the messages of measured vibration: loud below the fold, with faults of its own."""
    time = _sample_times(bits, bits.pick((0.5, 2.0, 5.0)), ship.seconds)
    below = np.abs(ship.speed(time)) < bits.pick((1.0, 0.7, 0.0))
    value = np.where(below, 120.0, 3.0) * (1.0 + 0.05 * bits.rough_normal(time.size))
    fault = bits.pick(('', '', 'stuck', 'bursts', 'lost', 'loud', 'odd', 'repeating'))
    block = np.asarray(time / 20.0, np.intp)
    chosen = bits.uniform(int(block[-1]) + 1)[block]
    if fault == 'stuck':
        value[value.size // 2 :] = value[value.size // 2]
    elif fault == 'bursts':
        value = np.where((time % 20.0 < 3.0) & (chosen < 0.5), 150.0, value)
    elif fault == 'loud':
        value = value * 20.0
    elif fault == 'odd':
        value = np.where(bits.uniform(value.size) < 0.05, np.nan, value)
        value = np.where(bits.uniform(value.size) < 0.05, -1.0, value)
    elif fault == 'repeating':
        value = np.floor(value / 4.0) * 4.0
    if parameters['level.unit'] == 'dB':
        # Near enough to decibels above 1: 3 is 10, 120 is 42.
        value = 7.0 + value * 0.3
    stamp = _to_nanoseconds(time, start_ns)
    sent = Messages(stamp, np.full(time.size, LEVEL, np.int8), stamp, value)
    return sent[chosen < 0.5] if fault == 'lost' and bool((chosen < 0.5).any()) else sent
