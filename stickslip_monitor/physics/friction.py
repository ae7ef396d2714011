# SPDX-License-Identifier: Apache-2.0
"""Friction laws: the coefficient of friction as an odd function of the relative speed.

Every law gives, for any array of relative speeds ``v`` [m/s], the coefficient ``mu(v)`` [-] and
its slope ``d mu / d|v|`` [s/m]. At ``v = 0`` friction is set-valued, ``[-static, static]``; the
functions return the positive end there and the slope from the right.

That is all a law needs. What is followed point by point, motions and long recordings, takes a law as
numbers for four functions: the laws of an exponential those of this module, any other as polynomials in
pieces those of :mod:`.friction_pieces`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, MutableSequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple, Protocol, TypeGuard, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import PhysicsError, require_finite, require_not_negative, require_positive
from stickslip_monitor.physics.friction_table import Tabulated as Tabulated
from stickslip_monitor.physics.series import INVERSE, LAW, RELATIVE_SPEED, STRIDE

ALMOST_REST = 1e-300
"""The smallest speed that is not rest, where a law has its coefficient of slow sliding [m/s]."""


@runtime_checkable
class FrictionLaw(Protocol):
    """Friction law as the dynamics needs it; a frozen dataclass with these members is one.

    >>> isinstance(Coulomb(static=0.3, kinetic=0.2), FrictionLaw)
    True
    """

    def __hash__(self) -> int: ...

    @property
    def static(self) -> float:
        """Largest coefficient that sticking can carry [-]."""

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Speeds ``> 0`` between which the law is smooth, ascending [m/s]; see :func:`speed_scales`."""

    def coefficient(self, speed: ArrayLike) -> FloatArray:
        """Return the coefficient at relative speeds [m/s], of their shape and sign [-]; ``static`` at 0."""

    def slope(self, speed: ArrayLike) -> FloatArray:
        """Return ``d mu / d|v|`` at relative speeds [m/s], of their shape [s/m]; from the right at 0."""


@lru_cache(maxsize=64)
def speed_scales(law: FrictionLaw) -> tuple[float, ...]:
    """Return the speeds > 0 between which a law is scanned, ascending [m/s]; ``()`` for a constant one.

    They are its breakpoints. For a law that names none they are speeds from 1e-6 to 1e4 m/s between which its
    slope changes, 2.5 times apart, or 1 m/s where it is straight: a law without any would never fall. Results
    are cached.

    >>> speed_scales(Stribeck(0.3, 0.1, 10.0)), speed_scales(Coulomb(0.3, 0.2))
    ((0.1, 0.4, 1.2, 4.0), ())
    """
    named = tuple(v for v in law.breakpoints if v > 0.0)
    speeds = np.geomspace(1e-6, 1e4, 51)
    slope = np.asarray(law.slope(speeds))
    if named or not np.any(slope):
        return named
    change = np.abs(np.diff(slope)) * speeds[1:]
    # Less change is left of Stribeck's law beyond its last breakpoint.
    rows = np.flatnonzero(change > 1e-12 * np.abs(law.coefficient(speeds[1:])))
    if not rows.size:
        return (1.0,)
    first = np.flatnonzero(change > 1e-2 * np.max(change))[0]
    return tuple(speeds[1:][first : rows[-1] + 2 : 2].tolist())


_Law = TypeVar('_Law')


def computes_as(law: object, kind: type[_Law]) -> TypeGuard[_Law]:
    """Return whether a law is of a class and has its ``static``, ``coefficient`` and ``slope`` unchanged.

    A subclass that overrides one of these is a law of the user's own: closed forms, tables
    and kernels of its parent do not hold for it.
    """
    names = ('static', 'coefficient', 'slope')
    same = all(getattr(type(law), name, None) is getattr(kind, name, None) for name in names)
    return isinstance(law, kind) and same


def _sign_of_speed(speed: FloatArray) -> FloatArray:
    """Return -1 for negative speeds, else 1, of their shape."""
    return np.where(speed < 0.0, -1.0, 1.0)


@dataclass(frozen=True, slots=True)
class Stribeck:
    """Exponential Stribeck law with an optional viscous rise.

    ``mu(v) = sgn(v) (mu_k + (mu_s - mu_k) exp(-beta |v|)) + nu v``

    A kinetic coefficient above the static one is accepted: friction then rises with speed and the
    equilibrium is stable at every speed.

    Args:
        static: ``mu_s`` >= 0 [-].
        kinetic: ``mu_k`` >= 0 [-].
        decay: ``beta`` > 0 [s/m].
        viscous: ``nu`` >= 0 [s/m].

    Raises:
        PhysicsError: A coefficient breaks its rule.

    >>> law = Stribeck(static=0.30, kinetic=0.10, decay=10.0)
    >>> law.coefficient([0.0, 0.1, -0.1]).round(4).tolist()  # at 1/beta: 0.1 + 0.2/e
    [0.3, 0.1736, -0.1736]
    """

    static: float
    kinetic: float
    decay: float
    viscous: float = 0.0

    def __post_init__(self) -> None:
        require_not_negative('static', self.static)
        require_not_negative('kinetic', self.kinetic)
        require_positive('decay', self.decay)
        require_not_negative('viscous', self.viscous)
        fall = (self.static - self.kinetic) * self.decay
        require_finite('(static - kinetic) * decay', fall, 's/m')

    @property
    def numbers(self) -> Exponential:
        """The law's parameters for :func:`friction_drop` and :func:`friction_slope`."""
        return Exponential(self.kinetic, self.static - self.kinetic, self.decay, self.viscous)

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Multiples of the decay speed: each panel between them is smooth at any ``beta``."""
        return tuple(multiple / self.decay for multiple in (1.0, 4.0, 12.0, 40.0))

    def coefficient(self, speed: ArrayLike) -> FloatArray:
        """Return ``mu(v)`` at relative speeds [m/s], an array of their shape [-]; ``mu_s`` at 0."""
        v = np.asarray(speed, dtype=float)
        falling = (self.static - self.kinetic) * np.exp(-self.decay * np.abs(v))
        return _sign_of_speed(v) * (self.kinetic + falling) + self.viscous * v

    def slope(self, speed: ArrayLike) -> FloatArray:
        """Return ``d mu / d|v|`` at relative speeds [m/s], of their shape [s/m]; from the right at 0."""
        v = np.abs(np.asarray(speed, dtype=float))
        return self.viscous - (self.static - self.kinetic) * self.decay * np.exp(-self.decay * v)


@dataclass(frozen=True, slots=True)
class Stretched:
    """Stribeck's law with an exponent, as B. Armstrong-Helouvry and others fit it.

    ``mu(v) = sgn(v) (mu_k + (mu_s - mu_k) exp(-(beta |v|)^delta)) + nu v``

    Args as of :class:`Stribeck`, and:
        exponent: ``delta``, 1 to 4 [-]: 2 is the Gaussian law. Below 1 the curve would leave zero
            speed vertically.

    Raises:
        PhysicsError: A number breaks its rule.
    """

    static: float
    kinetic: float
    decay: float
    viscous: float = 0.0
    exponent: float = 2.0

    def __post_init__(self) -> None:
        Stribeck(self.static, self.kinetic, self.decay, self.viscous)  # its rules are ours
        if not 1.0 <= self.exponent <= 4.0:
            raise PhysicsError(f'exponent = {self.exponent:g} must be between 1 and 4')

    @property
    def numbers(self) -> Exponential:
        """The law's parameters for :func:`friction_drop` and :func:`friction_slope`."""
        gap = self.static - self.kinetic
        return Exponential(self.kinetic, gap, self.decay, self.viscous, self.exponent)

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Multiples at which the exponent is reached: each panel between them is smooth."""
        places = (0.02, 0.2, 1.0, 4.0, 12.0, 40.0)
        return tuple(place ** (1.0 / self.exponent) / self.decay for place in places)

    def coefficient(self, speed: ArrayLike) -> FloatArray:
        """Return ``mu(v)`` at relative speeds [m/s], an array of their shape [-]; ``mu_s`` at 0."""
        v = np.asarray(speed, dtype=float)
        fading = np.exp(-((self.decay * np.abs(v)) ** self.exponent))
        falling = (self.static - self.kinetic) * fading
        return _sign_of_speed(v) * (self.kinetic + falling) + self.viscous * v

    def slope(self, speed: ArrayLike) -> FloatArray:
        """Return ``d mu / d|v|`` at relative speeds [m/s], of their shape [s/m]; from the right at 0."""
        u = self.decay * np.abs(np.asarray(speed, dtype=float))
        rate = self.decay * self.exponent * u ** (self.exponent - 1.0)
        fading = np.exp(-(u**self.exponent))
        return self.viscous - (self.static - self.kinetic) * rate * fading


def stribeck(
    static: float, kinetic: float, decay: float, viscous: float = 0.0, exponent: float = 1.0
) -> Stribeck | Stretched:
    """Return Stribeck's law, :class:`Stretched` where it has an exponent other than 1.

    Args:
        static: ``mu_s`` >= 0 [-].
        kinetic: ``mu_k`` >= 0 [-].
        decay: ``beta`` > 0 [s/m].
        viscous: ``nu`` >= 0 [s/m].
        exponent: ``delta``, 1 to 4 [-].

    Raises:
        PhysicsError: A parameter breaks its rule.
    """
    if exponent == 1.0:
        return Stribeck(static, kinetic, decay, viscous)
    return Stretched(static, kinetic, decay, viscous, exponent)


@dataclass(frozen=True, slots=True)
class Coulomb:
    """Coulomb's law: ``static`` at rest, ``kinetic`` while sliding.

    Args:
        static: ``mu_s`` >= 0 [-].
        kinetic: ``mu_k`` >= 0 [-].

    Raises:
        PhysicsError: A coefficient breaks its rule.

    >>> Coulomb(static=0.3, kinetic=0.2).coefficient([0.0, 1.0, -1.0]).tolist()
    [0.3, 0.2, -0.2]
    """

    static: float
    kinetic: float

    def __post_init__(self) -> None:
        require_not_negative('static', self.static)
        require_not_negative('kinetic', self.kinetic)

    @property
    def numbers(self) -> Exponential:
        """The law's parameters for :func:`friction_drop` and :func:`friction_slope`."""
        return Exponential(self.kinetic, 0.0, 0.0, 0.0)

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """No speed: the law is constant on each side of zero."""
        return ()

    def coefficient(self, speed: ArrayLike) -> FloatArray:
        """Return ``mu(v)`` at relative speeds [m/s], an array of their shape [-]; ``mu_s`` at 0."""
        v = np.asarray(speed, dtype=float)
        return np.where(v == 0.0, self.static, _sign_of_speed(v) * self.kinetic)

    def slope(self, speed: ArrayLike) -> FloatArray:
        """Return 0 for each relative speed, an array of their shape [s/m]."""
        return np.zeros_like(np.asarray(speed, dtype=float))


class Exponential(NamedTuple):
    """``mu_k + gap exp(-(beta v)^delta) + nu v`` of sliding ahead, with ``gap`` = mu_s - mu_k."""

    kinetic: float
    gap: float
    decay: float
    viscous: float
    exponent: float = 1.0


def _falling_part(law: Exponential, origin: float, step: float) -> tuple[float, float, float, float]:
    """Return the falling part of a law whose exponent is 1 or 2, and by how much a change of speed lowers it.

    Below ``v`` = 0 the exponential goes on for a distance of ``1/beta`` and is level from there.

    Args:
        law: Its numbers.
        origin: ``v`` >= 0 [m/s].
        step: Any change of speed [m/s].

    Returns:
        The part at ``v``, its fall without cancellation, and behind the step ``beta v`` and the exponent.
    """
    from_origin, more = law.decay * origin, law.decay * step
    more = max(more, -1.0 - from_origin)
    at = from_origin + more
    exponent = at
    if law.exponent != 1.0:
        # Of so fast a speed nothing is left, and its square is a number.
        at, from_origin = min(at, 1e60), min(from_origin, 1e60)
        more *= at + from_origin
        from_origin *= from_origin
        exponent = at * at
    top = law.gap * math.exp(-from_origin)
    # The larger of the two first, whose power is a number.
    fall = -top * math.expm1(-more) if more >= 0.0 else law.gap * math.exp(-exponent) * math.expm1(more)
    return top, fall, at, exponent


def friction_drop(law: Exponential, origin: float, step: float) -> float:
    """Return ``mu(v) - mu(v + step)`` of sliding ahead [-]; the law's exponent is 1 or 2.

    ``origin`` is ``v`` >= 0, ``step`` any change of speed [m/s].

    ``(mu_s - mu_k) (exp(-(beta v)^delta) - exp(-(beta (v + step))^delta)) - nu step``

    >>> round(friction_drop(Stribeck(0.3, 0.1, 10.0).numbers, 0.0, 0.1), 6)
    0.126424
    """
    return _falling_part(law, origin, step)[1] - law.viscous * step


def friction_slope(law: Exponential, speed: float) -> float:
    """Return ``d mu / d|v|`` at a relative speed [m/s], in s/m; from the right at ``v`` = 0.

    ``nu - (mu_s - mu_k) beta delta (beta |v|)^(delta - 1) exp(-(beta |v|)^delta)`` with ``delta`` 1 or 2.

    >>> friction_slope(Stribeck(0.5, 0.25, 10.0).numbers, 0.0)
    -2.5
    """
    at, rate = law.decay * abs(speed), law.decay
    if law.exponent != 1.0:
        at = min(at, 1e60)
        rate, at = 2.0 * rate * at, at * at
    return law.viscous - law.gap * rate * math.exp(-at)


# Places in the row of work: the series of the falling part, and three numbers for :func:`extend_series`.
_FALLING, _NUMBERS = LAW + STRIDE, LAW + 2 * STRIDE


def begin_series(
    law: Exponential, origin: float, slip: float, unit: float, work: MutableSequence[float]
) -> tuple[float, float, float]:
    """Begin the series of a law whose exponent is 1 or 2 in the row of work.

    Args:
        law: Its numbers.
        origin: Sliding speed from which the relative speed counts [m/s].
        slip: Relative speed at which the series begins, in units of speed.
        unit: The unit of the relative speed [m/s].
        work: Written: the falling part, and what :func:`extend_series` needs.

    Returns:
        The least and the greatest sliding speed at which the series holds [m/s], ``-inf`` and ``inf`` for no
        bound; and the :func:`friction_drop` from the origin to where it begins [-].
    """
    top, fall, at, exponent = _falling_part(law, origin, unit * slip)
    work[_FALLING] = top - fall
    work[_NUMBERS], work[_NUMBERS + 1], work[_NUMBERS + 2] = at, law.decay * unit, law.viscous * unit
    low = -math.inf
    if exponent > 12.0:
        # Towards rest order 16 sees what its powers leave out while the exponent changes by up to 12; of an
        # exponent above 40 nothing is left.
        low = min(exponent - 12.0, 40.0)
        low = (low if law.exponent == 1.0 else math.sqrt(low)) / law.decay
    return low, math.inf, fall - law.viscous * unit * slip


def extend_series(law: Exponential, k: int, work: MutableSequence[float]) -> float:
    """Return the coefficient of a power of the time in the series of ``mu`` [-].

    Args:
        law: Its numbers.
        k: The power, > 0; called after :func:`begin_series`, for 1, 2, 3 ... in turn.
        work: The row of work with the relative speed up to that power; written: the law's own series.
    """
    at, rate, slip = work[_NUMBERS], work[_NUMBERS + 1], work[RELATIVE_SPEED + k]
    exponent = rate * slip
    if law.exponent != 1.0:
        total = 0.0
        for j in range(1, k):
            total += work[RELATIVE_SPEED + j] * work[RELATIVE_SPEED + k - j]
        exponent = 2.0 * at * exponent + rate * rate * total
    work[LAW + k] = k * exponent  # of its derivative
    total = 0.0
    for j in range(2, k):  # earlier results first, so that a processor need not wait for the last one
        total += work[LAW + j] * work[_FALLING + k - j]
    total += work[LAW + 1] * work[_FALLING + k - 1] if k > 1 else 0.0
    work[_FALLING + k] = -work[INVERSE + k] * (total + work[LAW + k] * work[_FALLING])
    return work[_FALLING + k] + work[_NUMBERS + 2] * slip


LAWS: dict[str, tuple[Callable[..., FrictionLaw], tuple[str, ...]]] = {
    'stribeck': (stribeck, ('static', 'kinetic', 'decay', 'viscous', 'exponent')),
    'coulomb': (Coulomb, ('static', 'kinetic')),
    'tabulated': (Tabulated, ('speed', 'coefficient')),
}
"""By each law's name in a configuration: the function that makes it, and its parameters' names."""
