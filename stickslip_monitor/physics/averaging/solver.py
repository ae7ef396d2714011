# SPDX-License-Identifier: Apache-2.0
"""The solvers of the averaged equations behind one protocol: closed form, or numerical."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from stickslip_monitor.arrays import BoolArray, FloatArray
from stickslip_monitor.physics.averaging import closed_form, numerical
from stickslip_monitor.physics.friction import FrictionLaw, Stribeck, computes_as


class AveragedSolver(Protocol):
    """Boundaries and amplitudes of one friction law; every array has shape (n,).

    Speeds are ``V`` > 0 [m/s], ``q = c/N`` is the damping for each unit of load [s/m].
    """

    def boundaries(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Hopf and fold speed [m/s]; ``nan`` where there is none, ``inf`` without an end."""

    def hopf_speed(self, q: FloatArray) -> FloatArray:
        """The first of :meth:`boundaries`."""

    def peak_slope(self, speed: FloatArray) -> FloatArray:
        """Largest averaged negative slope of friction over all amplitudes [s/m]."""

    def has_cycle(self, speed: FloatArray, q: FloatArray, fold: FloatArray) -> BoolArray:
        """Where a stable cycle exists, given the fold speed."""

    def is_unstable(self, speed: FloatArray, q: FloatArray, hopf: FloatArray) -> BoolArray:
        """Where a small disturbance of steady sliding grows, given the Hopf speed."""

    def stable_amplitude(self, speed: FloatArray, q: FloatArray) -> FloatArray:
        """Velocity amplitude of the largest stable cycle, where there is one [m/s]."""

    def threshold_amplitude(
        self, speed: FloatArray, damping: float, load: FloatArray
    ) -> FloatArray:
        """Velocity amplitude of the smallest unstable cycle, where there is one [m/s]."""

    def cycles(
        self, speed: FloatArray, damping: float, load: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Every cycle's velocity amplitude [m/s], and 1.0 where it is stable, each (n, w)."""


def averaged_solver(law: FrictionLaw) -> AveragedSolver:
    """The solver of a law: in closed form for Stribeck's, numerical for any other."""
    return ClosedForm(law) if computes_as(law, Stribeck) else Numerical(law)


def damping_per_load(damping: float, load: FloatArray) -> FloatArray:
    """``q = c/N`` [s/m]; ``inf`` where there is no load. What it warns of means nothing."""
    return np.where(load > 0.0, damping / load, np.inf)


@dataclass(frozen=True, slots=True)
class ClosedForm:
    """See :mod:`stickslip_monitor.physics.averaging.closed_form`."""

    law: Stribeck

    def boundaries(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See :class:`AveragedSolver`."""
        return closed_form.boundaries(self.law, q)

    def hopf_speed(self, q: FloatArray) -> FloatArray:
        """See :class:`AveragedSolver`."""
        return closed_form.hopf_speed(self.law, q)

    def peak_slope(self, speed: FloatArray) -> FloatArray:
        """See :class:`AveragedSolver`."""
        return closed_form.peak_slope(self.law, speed)

    def has_cycle(self, speed: FloatArray, q: FloatArray, fold: FloatArray) -> BoolArray:
        """See :class:`AveragedSolver`."""
        return speed < fold

    def is_unstable(self, speed: FloatArray, q: FloatArray, hopf: FloatArray) -> BoolArray:
        """Told by the Hopf speed, which cannot underflow."""
        return speed < hopf

    def stable_amplitude(self, speed: FloatArray, q: FloatArray) -> FloatArray:
        """See :class:`AveragedSolver`."""
        return closed_form.stable_amplitude(self.law, speed, q)

    def threshold_amplitude(
        self, speed: FloatArray, damping: float, load: FloatArray
    ) -> FloatArray:
        """See :class:`AveragedSolver`."""
        return closed_form.threshold_amplitude(self.law, speed, damping, load)

    def cycles(
        self, speed: FloatArray, damping: float, load: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """See :class:`AveragedSolver`."""
        return closed_form.cycles(self.law, speed, damping, load)


@dataclass(frozen=True, slots=True)
class Numerical:
    """See :mod:`stickslip_monitor.physics.averaging.numerical`."""

    law: FrictionLaw

    def boundaries(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See :class:`AveragedSolver`."""
        return numerical.hopf_speed(self.law, q), numerical.fold_speed(self.law, q)

    def hopf_speed(self, q: FloatArray) -> FloatArray:
        """See :class:`AveragedSolver`."""
        return numerical.hopf_speed(self.law, q)

    def peak_slope(self, speed: FloatArray) -> FloatArray:
        """See :class:`AveragedSolver`."""
        return numerical.peak_slope(self.law, speed)

    def has_cycle(self, speed: FloatArray, q: FloatArray, fold: FloatArray) -> BoolArray:
        """There may be several such ranges of speed."""
        return numerical.has_cycle(self.law, speed, q, fold)

    def is_unstable(self, speed: FloatArray, q: FloatArray, hopf: FloatArray) -> BoolArray:
        """Where ``-mu'(V) > q``; there may be several such ranges of speed."""
        return -self.law.slope(speed) > q

    def stable_amplitude(self, speed: FloatArray, q: FloatArray) -> FloatArray:
        """See :class:`AveragedSolver`."""
        return numerical.stable_amplitude(self.law, speed, q)

    def threshold_amplitude(
        self, speed: FloatArray, damping: float, load: FloatArray
    ) -> FloatArray:
        """See :class:`AveragedSolver`."""
        return numerical.threshold_amplitude(self.law, speed, damping_per_load(damping, load))

    def cycles(
        self, speed: FloatArray, damping: float, load: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """See :class:`AveragedSolver`."""
        return numerical.cycles(self.law, speed, damping_per_load(damping, load))
