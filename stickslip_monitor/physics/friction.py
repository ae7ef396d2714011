# SPDX-License-Identifier: Apache-2.0
"""Friction laws: the coefficient of friction as an odd function of the relative speed.

Every law gives, for any array of relative speeds ``v`` [m/s], the coefficient ``mu(v)`` [-] and
its slope ``d mu / d|v|`` [s/m]. At ``v = 0`` friction is set-valued, ``[-static, static]``; the
functions return the positive end there and the slope from the right. The rules that any quantity
of the model must keep stand here too, each raising one sentence with name, value and rule.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol, TypeGuard, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import PhysicsError


def require_finite(name: str, value: float, unit: str = '') -> None:
    """Raise :class:`PhysicsError` unless the value is a finite number."""
    if not math.isfinite(value):
        raise PhysicsError(f'{name} = {f"{value:g} {unit}".rstrip()} must be a finite number')


def require_positive(name: str, value: float, unit: str = '') -> None:
    """Raise :class:`PhysicsError` unless the value is finite and above zero."""
    require_finite(name, value, unit)
    if not value > 0.0:
        raise PhysicsError(f'{name} = {f"{value:g} {unit}".rstrip()} must be greater than 0')


def require_not_negative(name: str, value: float, unit: str = '') -> None:
    """Raise :class:`PhysicsError` unless the value is finite and not below zero."""
    require_finite(name, value, unit)
    if value < 0.0:
        raise PhysicsError(f'{name} = {f"{value:g} {unit}".rstrip()} must not be negative')


def _show(value: float, unit: str) -> str:
    return f'{value:g} {unit}'.rstrip()


@runtime_checkable
class FrictionLaw(Protocol):
    """What the dynamics asks of a friction law."""

    def __hash__(self) -> int: ...

    @property
    def static(self) -> float:
        """Largest coefficient that sticking can carry [-]."""

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Speeds ``> 0`` at which a quadrature should be split, ascending [m/s]."""

    def coefficient(self, speed: ArrayLike) -> FloatArray:
        """Coefficient of friction at a relative speed [m/s], an array of its shape."""

    def slope(self, speed: ArrayLike) -> FloatArray:
        """Slope ``d mu / d|v|`` at a relative speed [m/s], an array of its shape [s/m]."""


_Law = TypeVar('_Law')


def computes_as(law: object, kind: type[_Law]) -> TypeGuard[_Law]:
    """Whether a law is of a kind and computes as that does.

    A subclass that overrides what a law gives is a law of the user's own: the closed forms, tables
    and kernels of its parent are not its own.
    """
    names = ('static', 'coefficient', 'slope')
    same = all(getattr(type(law), name, None) is getattr(kind, name, None) for name in names)
    return isinstance(law, kind) and same


def _sign(speed: FloatArray) -> FloatArray:
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
    def breakpoints(self) -> tuple[float, ...]:
        """Multiples of the decay speed: each panel between them is smooth at any ``beta``."""
        return tuple(multiple / self.decay for multiple in (1.0, 4.0, 12.0, 40.0))

    def coefficient(self, speed: ArrayLike) -> FloatArray:
        """See :class:`FrictionLaw`."""
        v = np.asarray(speed, dtype=float)
        falling = (self.static - self.kinetic) * np.exp(-self.decay * np.abs(v))
        return _sign(v) * (self.kinetic + falling) + self.viscous * v

    def slope(self, speed: ArrayLike) -> FloatArray:
        """See :class:`FrictionLaw`."""
        v = np.abs(np.asarray(speed, dtype=float))
        return self.viscous - (self.static - self.kinetic) * self.decay * np.exp(-self.decay * v)


@dataclass(frozen=True, slots=True)
class Stretched:
    """Stribeck's law with an exponent, as B. Armstrong-Helouvry and others fit it.

    ``mu(v) = sgn(v) (mu_k + (mu_s - mu_k) exp(-(beta |v|)^delta)) + nu v``

    Args as of :class:`Stribeck`, and:
        exponent: ``delta``, 1 to 4 [-]: 2 is the Gaussian law. Below 1 the curve would leave zero
            speed vertically.
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
    def breakpoints(self) -> tuple[float, ...]:
        """Where the exponent reaches these multiples: each panel between them is smooth."""
        places = (0.02, 0.2, 1.0, 4.0, 12.0, 40.0)
        return tuple(place ** (1.0 / self.exponent) / self.decay for place in places)

    def coefficient(self, speed: ArrayLike) -> FloatArray:
        """See :class:`FrictionLaw`."""
        v = np.asarray(speed, dtype=float)
        fading = np.exp(-((self.decay * np.abs(v)) ** self.exponent))
        falling = (self.static - self.kinetic) * fading
        return _sign(v) * (self.kinetic + falling) + self.viscous * v

    def slope(self, speed: ArrayLike) -> FloatArray:
        """See :class:`FrictionLaw`."""
        u = self.decay * np.abs(np.asarray(speed, dtype=float))
        rate = self.decay * self.exponent * u ** (self.exponent - 1.0)
        fading = np.exp(-(u**self.exponent))
        return self.viscous - (self.static - self.kinetic) * rate * fading


def stribeck(
    static: float, kinetic: float, decay: float, viscous: float = 0.0, exponent: float = 1.0
) -> Stribeck | Stretched:
    """Stribeck's law, :class:`Stretched` where it has an exponent other than 1."""
    if exponent == 1.0:
        return Stribeck(static, kinetic, decay, viscous)
    return Stretched(static, kinetic, decay, viscous, exponent)


def as_stribeck(law: FrictionLaw, what: str) -> Stribeck:
    """A law that has to be Stribeck's without an exponent.

    Raises:
        PhysicsError: It is another, which ``what`` does not cover.
    """
    if isinstance(law, Stribeck):
        return law
    own = type(law).__name__.lower()
    name = 'that with an exponent' if isinstance(law, Stretched) else own
    raise PhysicsError(f'{what} needs the friction law stribeck, and this is {name}')


@dataclass(frozen=True, slots=True)
class Coulomb:
    """Coulomb's law: ``static`` at rest, ``kinetic`` while sliding.

    Args:
        static: ``mu_s`` >= 0 [-].
        kinetic: ``mu_k`` >= 0 [-].

    Raises:
        PhysicsError: A coefficient breaks its rule.
    """

    static: float
    kinetic: float

    def __post_init__(self) -> None:
        require_not_negative('static', self.static)
        require_not_negative('kinetic', self.kinetic)

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """None: the law is constant on each side of zero."""
        return ()

    def coefficient(self, speed: ArrayLike) -> FloatArray:
        """See :class:`FrictionLaw`."""
        v = np.asarray(speed, dtype=float)
        return np.where(v == 0.0, self.static, _sign(v) * self.kinetic)

    def slope(self, speed: ArrayLike) -> FloatArray:
        """See :class:`FrictionLaw`."""
        return np.zeros_like(np.asarray(speed, dtype=float))


@dataclass(frozen=True, slots=True)
class Tabulated:
    """A measured friction curve, joined by the monotone cubic interpolant of Fritsch and Carlson.

    Below the first and above the last measured speed the coefficient stays at its end value, so
    nothing is claimed that was not measured.

    Args:
        speed: At least two relative speeds, >= 0 and strictly rising, shape (n,) [m/s].
        coefficient: The coefficients measured there, >= 0, shape (n,) [-].

    Attributes:
        cubics: The cubic of each interval in the distance from its begin, highest power first,
            shape (4, n - 1).

    Raises:
        PhysicsError: A table breaks its rule.
    """

    speed: tuple[float, ...]
    values: tuple[float, ...]
    cubics: FloatArray = field(init=False, repr=False, compare=False)
    _begins: FloatArray = field(init=False, repr=False, compare=False)
    _rises: FloatArray = field(init=False, repr=False, compare=False)

    def __init__(self, speed: Sequence[float], coefficient: Sequence[float]) -> None:
        v = _table_column('speed', speed)
        mu = _table_column('coefficient', coefficient)
        if len(v) != len(mu):
            raise PhysicsError(
                f'friction table has {len(v)} speeds and {len(mu)} coefficients: give one'
                ' coefficient for each speed'
            )
        if len(v) < 2:
            raise PhysicsError(f'friction table has {len(v)} point: give at least two')
        falling = np.flatnonzero(np.diff(v) <= 0.0)
        if falling.size:
            index = int(falling[0])
            raise PhysicsError(
                f'friction table speed[{index + 1}] = {v[index + 1]:g} m/s does not exceed'
                f' speed[{index}] = {v[index]:g} m/s: speeds must rise strictly'
            )
        for name, value in (
            ('speed', v),
            ('values', mu),
            ('cubics', _monotone_cubics(v, mu)),
            ('_begins', np.array(v[:-1])),
            ('_rises', np.sign(np.diff(mu))),
        ):
            object.__setattr__(self, name, value)

    @property
    def static(self) -> float:
        """The coefficient at the slowest measured speed [-]."""
        return self.values[0]

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """The measured speeds, where the interpolant changes from one cubic to the next."""
        return tuple(v for v in self.speed if v > 0.0)

    def coefficient(self, speed: ArrayLike) -> FloatArray:
        """See :class:`FrictionLaw`."""
        v = np.asarray(speed, dtype=float)
        i, s = self._place(np.minimum(np.maximum(np.abs(v), self.speed[0]), self.speed[-1]))
        a, b, c, d = self.cubics[:, i]
        value: FloatArray = ((a * s + b) * s + c) * s + d
        # At v = 0 the positive end, whatever the sign of zero.
        return np.copysign(value, v + 0.0)

    def slope(self, speed: ArrayLike) -> FloatArray:
        """See :class:`FrictionLaw`."""
        v = np.abs(np.asarray(speed, dtype=float))
        inside = np.minimum(np.maximum(v, self.speed[0]), self.speed[-1])
        i, s = self._place(inside)
        a, b, c, _ = self.cubics[:, i]
        derivative = (3.0 * a * s + 2.0 * b) * s + c
        # Where the curve turns level, rounding must not give its slope the wrong sign.
        falls_or_rises = derivative * self._rises[i] > 0.0
        return np.where((v == inside) & falls_or_rises, derivative, 0.0)

    def _place(self, inside: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
        """Interval of each measured speed, and the distance from its begin [m/s]."""
        i = np.searchsorted(self._begins[1:], inside, side='right')
        return i, inside - self._begins[i]


def _monotone_cubics(v: tuple[float, ...], mu: tuple[float, ...]) -> FloatArray:
    # Takes as long to import as all the rest, and only a table needs it.
    from scipy.interpolate import PchipInterpolator

    rule = 'friction table is too steep for its slope to be a finite number'
    try:
        with np.errstate(all='ignore'):
            cubics = np.asarray(PchipInterpolator(v, mu).c, dtype=float)
    except ValueError as error:
        raise PhysicsError(rule) from error
    if not np.isfinite(cubics).all():
        raise PhysicsError(rule)
    return cubics


def _table_column(name: str, values: Sequence[float]) -> tuple[float, ...]:
    column = tuple(float(value) for value in np.atleast_1d(np.asarray(values, dtype=float)))
    for index, value in enumerate(column):
        require_finite(f'friction table {name}[{index}]', value)
        require_not_negative(f'friction table {name}[{index}]', value)
    return column


LAWS: dict[str, tuple[Callable[..., FrictionLaw], tuple[str, ...]]] = {
    'stribeck': (stribeck, ('static', 'kinetic', 'decay', 'viscous', 'exponent')),
    'coulomb': (Coulomb, ('static', 'kinetic')),
    'tabulated': (Tabulated, ('speed', 'coefficient')),
}
"""What a configuration calls each law, what makes it, and the parameters it is made of."""
