# SPDX-License-Identifier: Apache-2.0
"""Simulated ships for the calibration study: linings by the averaged amplitude, with noise.

Another model than the likelihood's on purpose. The lining's complex amplitude, in units of
``v = beta V``, grows and decays at the averaged rate, is kicked by white noise and by blows, and
is held just above the sliding limit while it sticks. The bearings differ from what their
configuration says as the prior believes, and every passage has a boundary of its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.lab.calibration.evidence import BIN_NS, TelemetryBins, VibrationReport
from stickslip_monitor.physics.averaging.closed_form import growth, speed_for_decline
from stickslip_monitor.physics.friction import Stribeck
from stickslip_monitor.physics.oscillator import Bearing

Array = NDArray[np.float64]

BEARING = Bearing(50.0, 400.0, 2.0e6, Stribeck(0.30, 0.10, 10.0), 0.100)
_STEP = 0.02
_SCATTER = 0.02
_NOISE = 0.002
_BLOWS, _BLOW = 1.0 / 900.0, 0.5
_SQUEALS = 0.5
# Amplitude of the stick-slip cycle over the sliding limit: 1.005 to 1.13 for the exact cycle.
_CYCLE = 1.03


@dataclass(frozen=True, slots=True)
class Ship:
    """A bearing as it is.

    Attributes:
        log_beta: ``ln beta`` [ln s/m].
        log_load: ``ln N0`` [ln N].
        damping: ``c`` [N s/m].
    """

    log_beta: float
    log_load: float
    damping: float


@dataclass(frozen=True, slots=True, eq=False)
class Passage:
    """One dip of a ship, and what the lining did.

    Attributes:
        ship: The ship.
        course: What its sensors measured.
        sticking: Whether the lining stuck in each bin, shape (n,).
        log_beta: ``ln beta`` on this passage.
    """

    ship: Ship
    course: TelemetryBins
    sticking: NDArray[np.bool_]
    log_beta: float


def make_ships(count: int, random: np.random.Generator) -> list[Ship]:
    """Ships drawn with the spread of the default prior."""
    law = BEARING.friction
    ships = []
    for _ in range(count):
        damping, fall, decay = np.exp(random.standard_normal(3) * (0.40, 0.25, 0.30))
        c, delta = BEARING.damping * damping, (law.static - law.kinetic) * fall
        beta = law.decay * decay
        ships.append(Ship(math.log(beta), math.log(c / (delta * beta)), float(c)))
    return ships


def sail(
    ships: Sequence[Ship],
    dips: int,
    random: np.random.Generator,
    drift: float = 0.0,
    spread: float = 0.25,
) -> list[list[Passage]]:
    """Passages of ships down to slow speeds and up again, some too short for stick-slip.

    Args:
        ships: The ships.
        dips: Passages of each.
        random: Source of noise.
        drift: By how much ``ln N0`` falls from one passage to the next.
        spread: Loads are within this share of 1 kN.
    """
    made: list[list[Passage]] = [[] for _ in ships]
    for k in range(dips):
        moved = [Ship(s.log_beta, s.log_load - drift * k, s.damping) for s in ships]
        for own, passage in zip(made, _passages(moved, k, random, spread), strict=True):
            own.append(passage)
    return made


def _passages(
    ships: Sequence[Ship], number: int, random: np.random.Generator, spread: float
) -> list[Passage]:
    count = len(ships)
    beta, n0 = (np.exp([getattr(s, name) for s in ships]) for name in ('log_beta', 'log_load'))
    half_rate = np.array([s.damping for s in ships]) / (2.0 * BEARING.mass)
    own_beta = beta * np.exp(_SCATTER * random.standard_normal(count))
    load = 1000.0 * (1.0 + random.uniform(-spread, spread, count))
    decrement = np.maximum(np.log(load / n0), 0.3)
    fold, hopf = speed_for_decline(decrement) / beta, decrement / beta
    top, low = 1.35 * fold, hopf * random.uniform(0.55, 0.95, count)
    rate = np.exp(random.uniform(math.log(0.1), math.log(1.0), count))
    rate = np.clip(rate * BEARING.speed.factor('rpm'), (top - low) / 500.0, None)
    turn, stay = (top - low) / rate, random.uniform(10.0, 60.0, count)
    steps = math.ceil(float((2.0 * turn + stay).max()) / _STEP)
    phase, period = random.uniform(0.0, 2.0 * np.pi, (2, count)), random.uniform(6.0, 12.0, count)
    amplitude = np.full(count, 1e-3, dtype=complex)
    kept = math.ceil(steps * _STEP)
    speeds, loads, stuck = (np.zeros((kept, count)) for _ in range(3))
    per_bin = round(1.0 / _STEP)
    noise = _NOISE * math.sqrt(_STEP)
    for k in range(steps):
        t = k * _STEP
        down = np.minimum(t, turn) - np.clip(t - turn - stay, 0.0, turn)
        wave = 2.0 * np.pi * t / period
        v = (top - rate * down) * (1.0 + 0.02 * np.sin(wave + phase[0]))
        n = load * (1.0 + 0.02 * np.sin(0.9 * wave + phase[1]))
        limit = own_beta * v
        size = np.abs(amplitude)
        pace = half_rate * np.expm1(np.log(n / n0) - limit + growth(np.minimum(size, limit)))
        amplitude *= np.exp(np.clip(pace * _STEP, -1.0, 1.0))
        amplitude += noise * (random.standard_normal(count) + 1j * random.standard_normal(count))
        hit = random.random(count) < _BLOWS * _STEP
        if hit.any():
            kick = random.exponential(_BLOW, count) * limit
            amplitude += hit * kick * np.exp(2j * np.pi * random.random(count))
        size = np.abs(amplitude)
        most = _CYCLE * limit
        amplitude *= np.minimum(1.0, most / np.maximum(size, 1e-12))
        row = k // per_bin
        speeds[row] += v / per_bin
        loads[row] += n / per_bin
        stuck[row] += (np.abs(amplitude) > 0.9 * limit) / per_bin
    rpm = BEARING.speed.factor('rpm')
    speeds += 0.2 * rpm * random.standard_normal(speeds.shape)
    loads *= 1.0 + 0.01 * random.standard_normal(loads.shape)
    begin = number * 10**13
    times = begin + np.arange(kept, dtype=np.int64) * BIN_NS + BIN_NS // 2
    passages = []
    for j, ship in enumerate(ships):
        rows = slice(0, int(2.0 * turn[j] + stay[j]))
        course = TelemetryBins(
            f'passage {number + 1}', times[rows], speeds[rows, j], loads[rows, j]
        )
        sticking = stuck[rows, j] > _SQUEALS
        passages.append(Passage(ship, course, sticking, math.log(own_beta[j])))
    return passages


def reports_of(
    passage: Passage,
    random: np.random.Generator,
    tolerance: float,
    trust: float,
    swapped: float = 0.0,
) -> list[VibrationReport]:
    """What a level (or an operator) says of a passage.

    Args:
        passage: The passage.
        random: Source of errors.
        tolerance: Times are off by up to this [s].
        trust: What the reports claim.
        swapped: Share of reports that say the opposite.
    """
    time, stuck = passage.course.time_ns, passage.sticking
    edges = np.flatnonzero(np.diff(stuck.astype(int))) + 1
    at = [int(time[0]), *(int(time[e]) for e in edges), int(time[-1])]
    off = random.uniform(-0.5 * tolerance, 0.5 * tolerance, len(at)) * 1e9
    at = [at[0], *(int(a + o) for a, o in zip(at[1:-1], off[1:-1], strict=True)), at[-1]]
    reports = []
    for k, (start, end) in enumerate(pairwise(at)):
        squeal = bool(stuck[0]) ^ bool(k % 2)
        if random.random() < swapped:
            squeal = not squeal
        if end > start:
            source = f'report {k + 1}'
            reports.append(VibrationReport('ship', start, end, squeal, tolerance, trust, source))
    return reports
