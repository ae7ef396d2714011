# SPDX-License-Identifier: Apache-2.0
"""Harmonic balance with H harmonics by the alternating frequency/time method.

In units of ``V/omega`` and ``1/omega`` the motion is ``x'' + 2 zeta x' + x = lambda`` with the
friction force ``lambda``, set-valued where the relative speed ``v = 1 - x'`` is zero. Dynamic
Lagrangians make it single-valued: with ``Z`` the linear impedance,

    y = Z x + e (1 - x')  and  lambda = y - e v*,  where  y is in  lambda(v*) + e v*

has one solution ``v*`` once ``e`` exceeds the steepest fall of friction: ``v* = 0`` (stick) for
``|y| <= mu_s N``, else a scalar root (slip). At a solution ``v* = v``. ``e`` weighs how hard a
truncated series is held to the belt; the limit of many harmonics does not depend on it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.lab.accuracy.measurement import MethodResult, found, not_converged
from stickslip_monitor.lab.accuracy.time_stepping import turning_points
from stickslip_monitor.physics.averaging import stationary_amplitudes
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import Coulomb

_NEWTON, _HALVINGS, _INNER = 80, 12, 40
_CONVERGED = 1e-11
_SAMPLES_PER_HARMONIC, _FEWEST = 32, 256
_LINEAR, _ROOT = 2.0, 4.0
_FINE = 1024


class _Law:
    """The friction force in units of ``m omega V`` over relative speeds in units of ``V``."""

    def __init__(self, bearing: Bearing, speed: float, load: float) -> None:
        self.law, self.speed = bearing.friction, speed
        self.force = load / (bearing.mass * bearing.natural_frequency * speed)
        self.static = self.force * self.law.static
        panels = speed * np.linspace(0.0, 4.0, 401)
        fall = -self.force * speed * float(np.min(self.law.slope(panels)))
        scale = max(fall, 0.0) + self.static
        self.penalty = _LINEAR * scale + _ROOT * math.sqrt(scale)
        self.evaluations = 0

    def resolvent(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Relative speed ``v*`` of ``y``, and ``d v*/d y``; zero while sticking."""
        speed, slope = np.zeros_like(y), np.zeros_like(y)
        slips = np.abs(y) > self.static
        target = np.abs(y[slips])
        v = (target - self.static) / self.penalty
        rate = np.full_like(v, self.penalty)
        for _ in range(_INNER):
            self.evaluations += 1
            force = self.force * self.law.coefficient(self.speed * v)
            rate = self.penalty + self.force * self.speed * self.law.slope(self.speed * v)
            step = (target - force - self.penalty * v) / rate
            v = np.maximum(v + step, 0.0)
            if np.all(np.abs(step) <= 1e-14 * (1.0 + v)):
                break
        speed[slips] = np.sign(y[slips]) * v
        slope[slips] = 1.0 / rate
        return speed, slope


class _Series:
    """Fourier series with H harmonics: ``[a_0, a_1, b_1, a_2, b_2, ...]`` on a grid of phases."""

    def __init__(self, harmonics: int) -> None:
        wanted = max(_FEWEST, _SAMPLES_PER_HARMONIC * (harmonics + 1))
        count = 2 ** math.ceil(math.log2(wanted))
        phase = 2.0 * np.pi * np.arange(count) / count
        self.order = np.repeat(np.arange(1, harmonics + 1), 2)
        angle = phase[:, None] * np.arange(1, harmonics + 1)
        self.wave = np.ones((count, 2 * harmonics + 1))
        self.wave[:, 1::2], self.wave[:, 2::2] = np.cos(angle), np.sin(angle)
        self.project = 2.0 / count * self.wave.T
        self.project[0] *= 0.5
        # d/d(phase) of the coefficients: a_n <- n b_n, b_n <- -n a_n.
        size = 2 * harmonics + 1
        self.turn = np.zeros((size, size))
        for n in range(1, harmonics + 1):
            self.turn[2 * n - 1, 2 * n], self.turn[2 * n, 2 * n - 1] = n, -n


@dataclass(slots=True)
class _Problem:
    """The balance of one operating point at one number of harmonics."""

    series: _Series
    law: _Law
    damping: float

    def residual(self, q: FloatArray, frequency: float) -> tuple[FloatArray, FloatArray]:
        """Residual, and its Jacobian by the coefficients and (last column) the frequency."""
        s, e = self.series, self.law.penalty
        turn, size = s.turn, q.size
        rate, bend = turn @ q, turn @ (turn @ q)
        belt = np.zeros(size)
        belt[0] = 1.0
        impedance = np.eye(size) + frequency * (2.0 * self.damping * turn)
        impedance += frequency**2 * turn @ turn
        lean = belt - frequency * rate
        v, slope = self.law.resolvent(s.wave @ (impedance @ q + e * lean))
        by_q = np.empty((size, size + 1))
        by_q[:, :size] = impedance - e * frequency * turn
        by_q[:, size] = 2.0 * self.damping * rate + 2.0 * frequency * bend - e * rate
        # lambda - Z x = e ((1 - x') - v*): the Jacobian follows from the same chain.
        jacobian = -e * (s.project * slope) @ (s.wave @ by_q)
        jacobian[:, :size] -= e * frequency * turn
        jacobian[:, size] -= e * rate
        return e * (lean - s.project @ v), jacobian

    def solved(self, q: FloatArray, frequency: float) -> tuple[FloatArray, float, bool]:
        """The balance from a guess by damped semi-smooth Newton; the phase is ``b_1 = 0``.

        scipy's least-squares solvers find the same roots in five to sixty times the time.
        """
        free = np.delete(np.arange(q.size + 1), 2)
        z = np.append(q, frequency)
        value, jacobian = self.residual(q, frequency)
        for _ in range(_NEWTON):
            size = float(np.linalg.norm(value))
            if size <= _CONVERGED * self.law.penalty:
                return z[:-1], float(z[-1]), True
            step = np.zeros_like(z)
            step[free] = _solved(jacobian[:, free], -value)
            for halvings in range(_HALVINGS):
                trial = z + 0.5**halvings * step
                value, jacobian = self.residual(trial[:-1], float(trial[-1]))
                if float(np.linalg.norm(value)) < size:
                    break
            z = trial
        return z[:-1], float(z[-1]), False


def _solved(matrix: FloatArray, value: FloatArray) -> FloatArray:
    try:
        return np.asarray(np.linalg.solve(matrix, value))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(matrix, value, rcond=None)[0])


def half_range(q: FloatArray) -> float:
    """Half the peak-to-peak of a series."""
    n = np.arange(1, (q.size - 1) // 2 + 1)
    series = q[1::2] - 1j * q[2::2]
    count = max(_FINE, 16 * n.size)
    # One phase more than a turn, so that an extreme at its end is between two.
    phase = 2.0 * np.pi * np.arange(count + 2) / count
    waves = np.exp(1j * np.multiply.outer(phase, n))
    x, v, a = (np.real(waves @ ((1j * n) ** order * series)) for order in range(3))
    return 0.5 * float(np.ptp(turning_points(x, v, a, 2.0 * np.pi / count)))


def has_resolvent(bearing: Bearing) -> bool:
    """Whether the method applies: a jump at breakaway leaves the stick force undetermined."""
    law = bearing.friction
    return not isinstance(law, Coulomb) or law.static == law.kinetic


def harmonic_balance(harmonics: int, bearing: Bearing, speed: float, load: float) -> MethodResult:
    """Harmonic balance with H harmonics, from the KBM amplitude over 1, 3, 7, ... harmonics."""
    omega, law = bearing.natural_frequency, _Law(bearing, speed, load)
    cycles = stationary_amplitudes(bearing, speed, load)
    stable = cycles.amplitude[cycles.stable]
    if not stable.size:
        return found(math.nan, 0)
    q = np.array([law.force * float(law.law.coefficient(speed)), 0.0, 0.0])
    q[1], frequency, good = float(stable[-1]) * omega / speed, 1.0, False
    # By way of 1, 3, 7, ... harmonics.
    for rung in [2**k - 1 for k in range(1, harmonics.bit_length())] + [harmonics]:
        q = np.concatenate([q, np.zeros(2 * rung + 1 - q.size)])
        problem = _Problem(_Series(rung), law, bearing.damping_ratio)
        q, frequency, good = problem.solved(q, frequency)
    if not good:
        return not_converged(law.evaluations)
    size = half_range(q)
    # The solver may fall to steady sliding, which balances too.
    return found(size * speed / omega if size > 0.5 else math.nan, law.evaluations)
