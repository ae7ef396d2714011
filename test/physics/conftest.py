# SPDX-License-Identifier: Apache-2.0
"""The reference bearing, and an independent oracle: the averages of PHYSICS.md in mpmath.

A root is certified by a change of sign of the directly integrated balance just below and just
above it: that bounds its error without solving anything twice.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from types import ModuleType

import mpmath as mp
import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import quad

from stickslip_monitor.physics.friction import FrictionLaw, Stribeck
from stickslip_monitor.physics.oscillator import Bearing

mp.mp.dps = 40
_SPLITS = (-150, -40, -12, -4, -1, 0, 1, 4, 12, 40, 150)


@dataclass(frozen=True)
class Groups:
    """The dimensionless groups of PHYSICS.md, exact for the floats that went in."""

    v: mp.mpf
    kappa: mp.mpf
    r: mp.mpf
    decay: mp.mpf
    omega: mp.mpf


class Oracle:
    """KBM of the Stribeck law by direct integration at 40 digits; nothing here is a Bessel."""

    @staticmethod
    def groups(bearing: Bearing, speed: float, load: float) -> Groups:
        law = bearing.friction
        assert isinstance(law, Stribeck)
        delta, decay = mp.mpf(law.static) - mp.mpf(law.kinetic), mp.mpf(law.decay)
        return Groups(
            v=decay * mp.mpf(speed),
            kappa=(mp.mpf(bearing.damping) / load + mp.mpf(law.viscous)) / (delta * decay),
            r=mp.mpf(law.kinetic) / delta,
            decay=decay,
            omega=mp.sqrt(mp.mpf(bearing.stiffness) / mp.mpf(bearing.mass)),
        )

    @staticmethod
    def harmonic(v: mp.mpf, alpha: mp.mpf, r: mp.mpf) -> mp.mpf:
        """``S/Delta`` by integrating ``mu(V - a cos t) cos t`` piece by piece."""
        cuts = {mp.mpf(0), mp.pi}
        cuts |= {mp.acos((v - level) / alpha) for level in _SPLITS if abs(v - level) < alpha}

        def integrand(t: mp.mpf) -> mp.mpf:
            relative = v - alpha * mp.cos(t)
            return mp.sign(relative) * (r + mp.exp(-abs(relative))) * mp.cos(t)

        return mp.quad(integrand, sorted(cuts)) / mp.pi

    @staticmethod
    def hopf(kappa: mp.mpf) -> mp.mpf:
        return -mp.log(kappa)

    def balance(self, groups: Groups, alpha: mp.mpf) -> mp.mpf:
        """``S/Delta - kappa alpha/2``: a cycle where it vanishes, growth where it is positive."""
        return self.harmonic(groups.v, alpha, groups.r) - groups.kappa * alpha / 2

    def fold_excess(self, groups: Groups, v: mp.mpf) -> mp.mpf:
        """The balance at the sliding limit ``a = V``: positive below the fold speed."""
        return self.harmonic(v, v, groups.r) - groups.kappa * v / 2


class BruteForce:
    """KBM of any law: a fine scan of the balance by the midpoint rule, and scipy quad."""

    def __init__(self, angles: int = 4000, amplitudes: int = 2000) -> None:
        self._cosine = np.cos((np.arange(angles) + 0.5) * np.pi / angles)
        self._x = np.linspace(0.0, 2.0, amplitudes + 2)[1:-1]

    def balance(
        self, law: FrictionLaw, speed: float, q: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Velocity amplitudes, dense from 0 to 1000 V, and ``2 S/a - c/N`` there."""
        beyond = np.maximum(self._x - 1.0, 0.0) * 0.5 * np.pi
        a = np.where(self._x <= 1.0, speed * self._x, speed / np.cos(beyond))
        s = np.concatenate(
            [
                np.mean(law.coefficient(speed - part[:, None] * self._cosine) * self._cosine, 1)
                for part in np.array_split(a, 20)
            ]
        )
        return a, 2.0 * s / a - q

    def cycles(
        self, law: FrictionLaw, speed: float, q: float
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Velocity amplitudes of all cycles, to the scan's step, and their stability."""
        a, f = self.balance(law, speed, q)
        index = np.flatnonzero((f[:-1] > 0.0) != (f[1:] > 0.0))
        return 0.5 * (a[index] + a[index + 1]), f[index] > 0.0

    @staticmethod
    def harmonic(law: FrictionLaw, speed: float, amplitude: float) -> float:
        """``S`` by adaptive quadrature, split wherever the law is not smooth."""
        levels = [0.0, *law.breakpoints, *(-level for level in law.breakpoints)]
        cosines = [(speed - level) / amplitude for level in levels]
        cuts = np.unique([0.0, np.pi, *(np.arccos(x) for x in cosines if -1.0 < x < 1.0)])

        def integrand(t: float) -> float:
            return float(law.coefficient(speed - amplitude * np.cos(t))) * float(np.cos(t))

        total = 0.0
        for left, right in pairwise(cuts):
            total += quad(integrand, left, right, epsabs=1e-13, epsrel=1e-13, limit=200)[0]
        return total / np.pi


class Sampled:
    """A law known to a solver by its two functions only, which count how often they are asked."""

    def __init__(self, law: FrictionLaw) -> None:
        self.law, self.calls = law, 0

    @property
    def static(self) -> float:
        return self.law.static

    @property
    def breakpoints(self) -> tuple[float, ...]:
        return self.law.breakpoints

    def coefficient(self, speed: ArrayLike) -> NDArray[np.float64]:
        self.calls += 1
        return self.law.coefficient(speed)

    def slope(self, speed: ArrayLike) -> NDArray[np.float64]:
        self.calls += 1
        return self.law.slope(speed)


@pytest.fixture(scope='session')
def sampled() -> type[Sampled]:
    return Sampled


@pytest.fixture(scope='session')
def oracle() -> Oracle:
    return Oracle()


@pytest.fixture(scope='session')
def brute_force() -> BruteForce:
    return BruteForce()


@pytest.fixture(scope='session')
def taylor() -> ModuleType:
    """The exact cycle by Taylor series in 40 digits: test_cycle_reference.py."""
    path = Path(__file__).with_name('cycle') / 'test_cycles_reference.py'
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope='session')
def reference() -> Bearing:
    """The reference bearing of PHYSICS.md (law mu_s 0.30, mu_k 0.10, beta 10 s/m)."""
    return Bearing(50.0, 400.0, 2.0e6, Stribeck(0.30, 0.10, 10.0), 0.100)


@pytest.fixture(scope='session')
def rpm(reference: Bearing) -> float:
    """Surface speed of one revolution a minute, ``pi D / 60`` [m/s]."""
    return float(np.pi * reference.journal_diameter / 60.0)


@pytest.fixture(scope='session')
def make_bearing() -> Callable[..., tuple[Bearing, float]]:
    """Build a Stribeck bearing from groups: returns it and the load that gives ``kappa``."""

    def build(
        mass: float, omega: float, kappa: float, r: float, decay: float, zeta: float = 0.02
    ) -> tuple[Bearing, float]:
        delta = 0.2
        law = Stribeck(delta * (1.0 + r), delta * r, decay)
        damping = 2.0 * zeta * mass * omega
        load = damping / (kappa * (law.static - law.kinetic) * decay)
        return Bearing(mass, damping, mass * omega * omega, law, 0.1), load

    return build
