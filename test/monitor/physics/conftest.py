# SPDX-License-Identifier: Apache-2.0
"""The reference bearing, and an independent oracle: the averages of PHYSICS.md in mpmath.

A root is certified by a change of sign of the directly integrated balance just below and just
above it: that bounds its error without solving anything twice.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import quad
from shared import REFERENCE_BEARING

from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import FrictionLaw, Stribeck

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
        """Return the balance at the sliding limit ``a = V``: positive below the fold speed."""
        return self.harmonic(v, v, groups.r) - groups.kappa * v / 2


def friction_harmonic(law: FrictionLaw, speed: float, amplitude: float) -> float:
    """``S`` of any law by scipy's adaptive quadrature, split wherever the law is not smooth."""
    levels = [0.0, *law.breakpoints, *(-level for level in law.breakpoints)]
    cosines = [(speed - level) / amplitude for level in levels]
    cuts = np.unique([0.0, np.pi, *(np.arccos(x) for x in cosines if -1.0 < x < 1.0)])

    def integrand(t: float) -> float:
        return float(law.coefficient(speed - amplitude * np.cos(t))) * float(np.cos(t))

    options = {'epsabs': 1e-13, 'epsrel': 1e-13, 'limit': 200}
    return sum(quad(integrand, *piece, **options)[0] for piece in pairwise(cuts)) / np.pi


@pytest.fixture(scope='session')
def harmonic_by_quad() -> Callable[[FrictionLaw, float, float], float]:
    return friction_harmonic


@pytest.fixture(scope='session')
def oracle() -> Oracle:
    return Oracle()


@pytest.fixture
def float_errors() -> Iterator[None]:
    """Raise where a number overflows, is invalid or is divided by zero; underflow to zero is meant."""
    with np.errstate(divide='raise', over='raise', invalid='raise'):
        yield


@pytest.fixture(scope='session')
def reference() -> Bearing:
    """Return the reference bearing of PHYSICS.md (law mu_s 0.30, mu_k 0.10, beta 10 s/m)."""
    return REFERENCE_BEARING


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
