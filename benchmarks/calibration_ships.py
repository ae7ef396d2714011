# SPDX-License-Identifier: Apache-2.0
"""Simulated ships for the calibration study: linings by the averaged amplitude, with sensors.

The lining's complex velocity amplitude ``a`` grows and decays at the averaged rate of its own
friction law, ``d ln a/dt = (N S(a; V)/a - c/2)/m``, is kicked by white noise and by blows, and is
held just above the sliding limit while it sticks. The bearings differ from what their
configuration says as the prior believes, and every passage has a boundary of its own. What the
sensors send of it has their rates, lags, noise and bias.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.physics.averaging import fold_speed, harmonic, hopf_speed
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import FrictionLaw, Stretched, Stribeck, Tabulated

Array = NDArray[np.float64]

_STEP, _KEPT = 0.05, 2
# Blows a second, and their mean size in sliding limits.
_BLOWS, _BLOW = 1.0 / 900.0, 0.5
# Amplitude of the stick-slip cycle over the sliding limit: 1.005 to 1.13 for the exact cycle.
_CYCLE = 1.03
_SPEEDS, _SIZES = 80, 24


@dataclass(frozen=True, slots=True)
class Kind:
    """Spreads from which ships are drawn: standard deviations or ranges."""

    damping: float = 0.40  # of the configured damping
    fall: float = 0.25  # of the configured mu_s - mu_k
    decay: float = 0.30  # of the configured decay
    scatter: float = 0.02  # of a passage's own boundary, as a load
    bias: float = 0.03  # of the load from recording to recording
    ramps: tuple[float, float] = (60.0, 600.0)  # from 2 V_F to 0.2 V_F [s]
    noise: float = 0.002  # kicks of the lining [shares of the decay speed in a second^1/2]
    lag: tuple[float, float] = (0.1, 1.0)  # of the tachometer [s]
    drift: float = 0.0  # by how much ln q rises from passage to passage
    spread: float = 0.25  # loads are within this share of the middle
    wrong: float = 0.0  # the damping of the drawing over the true one, where it is given


@dataclass(frozen=True, slots=True)
class Ship:
    """A bearing as it is, and as its drawing has it."""

    true: Bearing
    drawn: Bearing
    load: float  # in the middle of its voyages [N]
    rate: float  # of its sensors [Hz]
    lag: float  # of its tachometer [s]
    level_lag: float  # of its level [s]
    floor: float  # of its level, below that of the cycle at the fold [dB]

    def fold(self, load: float) -> float:
        """Return the true fold speed [m/s]."""
        return float(fold_speed(self.true, load))

    def hopf(self, load: float) -> float:
        """Return the true Hopf speed [m/s]."""
        return float(hopf_speed(self.true, load))


@dataclass(frozen=True, slots=True, eq=False)
class Passage:
    """Measurements of the sensors over one passage, and when the lining stuck."""

    time: Array  # shape (n,) [s]
    speed: Array  # of the surface, shape (n,) [m/s]
    load: Array  # shape (n,) [N]
    level: Array  # shape (n,) [dB]
    episodes: tuple[tuple[float, float], ...]  # first and last second of sticking
    true_load: float  # what the lining carries, its own scatter too [N]


def _draw_law(number: int, random: np.random.Generator) -> FrictionLaw:
    """Draw one of five kinds of laws, as a drawing has it."""
    decay, fall = random.uniform(6.0, 16.0), random.uniform(0.12, 0.25)
    kinetic = random.uniform(0.05, 0.12)
    kind = number % 5
    if kind == 1:
        return Stribeck(kinetic + fall, kinetic, decay, random.uniform(0.01, 0.05) * decay * fall)
    if kind == 2:
        return Stretched(kinetic + fall, kinetic, 0.6 * decay, 0.0, random.uniform(1.2, 2.0))
    if kind == 3:
        speed = np.linspace(0.0, 8.0 / decay, 25)
        return Tabulated(speed.tolist(), (kinetic + fall * np.exp(-decay * speed)).tolist())
    return Stribeck(kinetic + fall, kinetic, decay)


def _change_law(law: FrictionLaw, fall: float, decay: float) -> FrictionLaw:
    """Return a law with another fall and another decay, by factors."""
    if isinstance(law, Tabulated):
        kinetic = min(law.values)
        values = [kinetic + fall * (value - kinetic) for value in law.values]
        return Tabulated([v / decay for v in law.speed], values)
    assert isinstance(law, Stribeck | Stretched)
    static = law.kinetic + fall * (law.static - law.kinetic)
    return replace(law, static=static, decay=law.decay * decay)


def make_ships(count: int, random: np.random.Generator, kind: Kind) -> list[Ship]:
    """Draw ships with a bistable range of at least 8 % at their loads."""
    ships: list[Ship] = []
    while len(ships) < count:
        law = _draw_law(len(ships), random)
        mass, damping = np.exp(random.uniform(np.log([20.0, 200.0]), np.log([200.0, 900.0])))
        stiffness = mass * random.uniform(120.0, 260.0) ** 2
        configured = Bearing(mass, damping, stiffness, law, random.choice([0.1, 0.3, 0.5]))
        c, fall, decay = np.exp(random.standard_normal(3) * (kind.damping, kind.fall, kind.decay))
        c = 1.0 / kind.wrong if kind.wrong else c
        true = replace(configured, damping=damping * c, friction=_change_law(law, fall, decay))
        onset = damping / (0.2 * 10.0)
        load = onset * random.uniform(3.0, 12.0)
        ship = Ship(
            true,
            configured,
            load,
            float(np.exp(random.uniform(*np.log([0.5, 10.0])))),
            random.uniform(*kind.lag),
            random.uniform(0.1, 0.6),
            random.uniform(14.0, 26.0),
        )
        low, high = (1.0 - kind.spread) * load, (1.0 + kind.spread) * load
        configured_fold = float(fold_speed(configured, low))
        ratio = ship.hopf(low) / ship.fold(low)
        if configured_fold > 0.0 and 0.2 < ratio < 0.92 and ship.hopf(high) > 0.0:
            ships.append(ship)
    return ships


def _tabulate_drives(ships: Sequence[Ship]) -> tuple[Array, Array, Array]:
    """Return ``S(a; V)/a`` of each ship over ln V and a/V, with where ln V begins and its step."""
    share = np.linspace(0.0, 1.0, _SIZES)
    share[0] = 1e-3
    tables, first, steps = [], [], []
    for ship in ships:
        fold = ship.fold(2.0 * ship.load)
        log_v = np.linspace(math.log(0.05 * fold), math.log(4.0 * fold), _SPEEDS)
        v = np.exp(log_v)[:, None]
        tables.append(harmonic(ship.true.friction, v, share * v) / (share * v))
        first.append(log_v[0])
        steps.append(log_v[1] - log_v[0])
    return np.stack(tables), np.array(first), np.array(steps)


def sail_passages(
    ships: Sequence[Ship], passages: int, random: np.random.Generator, kind: Kind
) -> list[list[Passage]]:
    """Sail passages of each ship from fast to slow and up again."""
    count = len(ships) * passages
    who, number = np.divmod(np.arange(count), passages)
    base = np.array([ship.load for ship in ships])[who]
    load = base * (1.0 + random.uniform(-kind.spread, kind.spread, count))
    factor = np.exp(kind.scatter * random.standard_normal(count) + kind.drift * number)
    fold = np.array([ships[k].fold(n) for k, n in zip(who, load, strict=True)])
    hopf = np.array([ships[k].hopf(n) for k, n in zip(who, load, strict=True)])
    ramp = np.exp(random.uniform(*np.log(kind.ramps), count))
    rate = 1.8 * fold / ramp
    low = hopf * random.uniform(0.4, 0.9, count)
    top = 2.0 * fold
    turn, stay = (top - low) / rate, random.uniform(10.0, 60.0, count)
    length = 2.0 * turn + stay
    order = np.argsort(-length)
    amplitude = _follow_amplitudes(
        ships, who, order, (top, low, rate, turn, stay), load * factor, random, kind
    )
    passages_by_ship: list[list[Passage]] = [[] for _ in ships]
    for j in range(count):
        course = (top[j], rate[j], turn[j], stay[j])
        size = amplitude[j][: int(length[j] / (_STEP * _KEPT))]
        passages_by_ship[who[j]].append(
            _measure_passage(ships[who[j]], size, course, (load[j], factor[j]), int(number[j]), random, kind)
        )
    return passages_by_ship


def _speed_at(t: Array, top: Array, rate: Array, turn: Array, stay: Array) -> Array:
    down = np.minimum(t, turn) - np.clip(t - turn - stay, 0.0, turn)
    return np.asarray(top - rate * down)


def _follow_amplitudes(
    ships: Sequence[Ship],
    who: NDArray[np.intp],
    order: NDArray[np.intp],
    course: tuple[Array, ...],
    load: Array,
    random: np.random.Generator,
    kind: Kind,
) -> list[Array]:
    """Return the amplitude over speed of each passage, every ``_KEPT`` steps."""
    tables, first, step = _tabulate_drives(ships)
    who = who[order]
    top, _, rate, turn, stay = (column[order] for column in course)
    n, length = load[order], 2.0 * turn + stay
    mass = np.array([ship.true.mass for ship in ships])[who]
    half = 0.5 * np.array([ship.true.damping for ship in ships])[who]
    noise = kind.noise * math.sqrt(_STEP) * top
    flat, origin, per = tables.reshape(len(ships), -1), first[who], 1.0 / step[who]
    wave = random.uniform(0.0, 2.0 * math.pi, who.size), random.uniform(6.0, 12.0, who.size)
    a = 1e-3 * top.astype(complex)
    amplitudes = np.zeros((math.ceil(float(length[0]) / _STEP) // _KEPT + 1, who.size), np.float32)
    for k in range(math.ceil(float(length[0]) / _STEP)):
        t = k * _STEP
        m = int(np.searchsorted(-length, -t))
        if not m:
            break
        v = _speed_at(np.full(m, t), top[:m], rate[:m], turn[:m], stay[:m])
        v *= 1.0 + 0.02 * np.sin(2.0 * math.pi * t / wave[1][:m] + wave[0][:m])
        size = np.abs(a[:m])
        row = np.clip((np.log(v) - origin[:m]) * per[:m], 0.0, _SPEEDS - 1.001)
        column = np.minimum(size / v, 1.0) * (_SIZES - 1.001)
        i, j = row.astype(np.intp), column.astype(np.intp)
        p, q, at = row - i, column - j, i * _SIZES + j
        row_ship = who[:m]
        low = flat[row_ship, at] * (1.0 - q) + flat[row_ship, at + 1] * q
        high = flat[row_ship, at + _SIZES] * (1.0 - q) + flat[row_ship, at + _SIZES + 1] * q
        pace = (n[:m] * (low * (1.0 - p) + high * p) - half[:m]) / mass[:m]
        a[:m] *= np.exp(np.clip(pace * _STEP, -1.0, 1.0))
        a[:m] += noise[:m] * (random.standard_normal(m) + 1j * random.standard_normal(m))
        hit = random.random(m) < _BLOWS * _STEP
        if hit.any():
            a[:m] += hit * random.exponential(_BLOW, m) * v
        size = np.abs(a[:m])
        a[:m] *= np.minimum(1.0, _CYCLE * v / np.maximum(size, 1e-15))
        if k % _KEPT == 0:
            amplitudes[k // _KEPT, :m] = np.minimum(size / v, _CYCLE)
    by_passage: list[Array] = [np.empty(0)] * who.size
    for place, original in enumerate(order):
        by_passage[original] = amplitudes[:, place].astype(float)
    return by_passage


def _apply_lag(values: Array, lag: float, step: float) -> Array:
    """Return a first-order lag [s] of values that are a step apart."""
    from scipy.signal import lfilter

    keep = math.exp(-step / lag)
    lagged, _ = lfilter([1.0 - keep], [1.0, -keep], values, zi=[keep * values[0]])
    return np.asarray(lagged)


def _measure_passage(
    ship: Ship,
    over: Array,
    course: tuple[float, ...],
    loads: tuple[float, float],
    number: int,
    random: np.random.Generator,
    kind: Kind,
) -> Passage:
    step, (load, factor) = _STEP * _KEPT, loads
    t = np.arange(over.size) * step
    v = _speed_at(t, *(np.asarray(quantity) for quantity in course))
    measured_speed = _apply_lag(v, ship.lag, step) * (1.0 + 0.004 * random.standard_normal(t.size))
    power = _apply_lag((over * v) ** 2, ship.level_lag, step)
    background = 10.0 ** (-ship.floor / 20.0) * ship.fold(load)
    decibels = 10.0 * np.log10(power + background**2) + random.standard_normal(t.size)
    bias = math.exp(kind.bias * random.standard_normal())
    measured = load * bias * (1.0 + 0.01 * random.standard_normal(t.size))
    every = max(1, round(1.0 / (ship.rate * step)))
    stuck = np.flatnonzero(np.diff((over > 0.9).astype(int), prepend=0, append=0)).reshape(-1, 2)
    begin = 1e4 * number + 1e3
    episodes = tuple((begin + a * step, begin + b * step) for a, b in stuck.tolist())
    part = slice(int(random.integers(every)), None, every)
    true = load * factor
    return Passage(begin + t[part], measured_speed[part], measured[part], decibels[part], episodes, true)
