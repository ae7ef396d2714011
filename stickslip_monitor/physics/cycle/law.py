# SPDX-License-Identifier: Apache-2.0
"""Friction laws in the units of the exact cycle, written so that nothing cancels.

Speeds are in units of the journal's surface speed ``V``, time in units of ``1/omega``, forces in
units of ``m omega V``. The relative speed is ``w = reference + z``, where the reference is 0 (the
breakaway) or 1 (steady sliding), and the equations ask for the friction lost on the way,

    rise(z) = N (mu(V reference) - mu(V (reference + z))) / (m omega V),

with the static coefficient at reference 0. A law is continued smoothly below ``w = 0``: a step
that looks a little past the contact must not see the reversal of friction, which is handled as
an event. All parameters have shape (n, 1), so that a law acts on arrays of shape (n, nodes).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from stickslip_monitor.arrays import FloatArray, IndexArray
from stickslip_monitor.physics.friction import (
    Coulomb,
    FrictionLaw,
    Stribeck,
    Tabulated,
    computes_as,
)

# Size, against the friction itself, below which differences of it are mostly rounding.
_GRAIN = 1e-7
# The one-sided limit of a law at v = 0+ is taken here: v = 0 itself is set-valued.
ALMOST_REST = 1e-300


class ScaledLaw(Protocol):
    """What the slip phase asks of a friction law."""

    @property
    def pieces(self) -> FloatArray | None:
        """Interior edges ``w`` V [m/s] between smooth pieces, ascending; ``None`` if smooth."""

    @property
    def jump(self) -> FloatArray:
        """Friction lost in the instant of breakaway, ``rise(0+)`` at reference 0, shape (n,)."""

    @property
    def grain(self) -> FloatArray:
        """Size of ``rise`` up to which it is not known to many digits, shape (n,)."""

    @property
    def sharpness(self) -> FloatArray:
        """How often the friction's fall shrinks by e over a relative speed of 1, shape (n,)."""

    def take(self, index: IndexArray, piece: IndexArray) -> ScaledLaw:
        """The law of some of the elements, each on the given smooth piece."""

    def rise(self, z: FloatArray) -> FloatArray:
        """Friction lost between the reference and ``z``, shape (n, nodes)."""

    def slope(self, z: FloatArray) -> FloatArray:
        """``d rise / dz``, shape (n, nodes)."""


def _continued(exponent: FloatArray) -> FloatArray:
    """``exp(x) - 1``, along its tangent above 1: a continuation must not run away."""
    continued: FloatArray = np.expm1(np.minimum(exponent, 1.0))
    return continued + np.e * np.maximum(exponent - 1.0, 0.0)


@dataclass(frozen=True, slots=True)
class ScaledStribeck:
    """Stribeck's law: ``rise = gap exp(-b reference) (1 - exp(-b z)) - viscous z``."""

    gap: FloatArray
    decay: FloatArray
    viscous: FloatArray
    reference: float

    @property
    def pieces(self) -> None:
        """One smooth piece."""
        return

    @property
    def jump(self) -> FloatArray:
        """None: the law is continuous at breakaway."""
        return np.zeros(self.gap.shape[0])

    @property
    def grain(self) -> FloatArray:
        """None: differences are formed analytically."""
        return np.zeros(self.gap.shape[0])

    @property
    def sharpness(self) -> FloatArray:
        """``beta V``."""
        sharpness: FloatArray = self.decay[:, 0]
        return sharpness

    def take(self, index: IndexArray, piece: IndexArray) -> ScaledStribeck:
        """See :class:`ScaledLaw`."""
        return ScaledStribeck(
            self.gap[index], self.decay[index], self.viscous[index], self.reference
        )

    def rise(self, z: FloatArray) -> FloatArray:
        """See :class:`ScaledLaw`."""
        if self.reference == 0.0:
            return -self.gap * _continued(-self.decay * z) - self.viscous * z
        exponent = -self.decay * (self.reference + z)
        # exp(-b) (1 - exp(-b z)) without 0 * inf for a large decay, nor cancellation at small z.
        nearer = np.minimum(np.maximum(-self.decay * self.reference, exponent), 0.0)
        nearby = np.sign(z) * np.exp(nearer) * -np.expm1(-self.decay * np.abs(z))
        beyond = np.expm1(-self.decay * self.reference) - _continued(exponent)
        return self.gap * np.where(exponent > 0.0, beyond, nearby) - self.viscous * z

    def slope(self, z: FloatArray) -> FloatArray:
        """See :class:`ScaledLaw`."""
        exponent = np.minimum(-self.decay * (self.reference + z), 1.0)
        return self.gap * self.decay * np.exp(exponent) - self.viscous


@dataclass(frozen=True, slots=True)
class ScaledTable:
    """A measured table: one cubic between two measured speeds, constant outside them."""

    force: FloatArray
    speed: FloatArray
    reference: float
    top: FloatArray
    left: FloatArray
    cubic: FloatArray
    piece: IndexArray

    @property
    def pieces(self) -> FloatArray:
        """The measured speeds above zero [m/s]."""
        return self.left[1:]

    @property
    def jump(self) -> FloatArray:
        """None: the table's first value is the static coefficient."""
        return np.zeros(self.force.shape[0])

    @property
    def grain(self) -> FloatArray:
        """See :class:`ScaledLaw`."""
        grain: FloatArray = _GRAIN * (self.force * self.top)[:, 0]
        return grain

    @property
    def sharpness(self) -> FloatArray:
        """None: a cubic between two measured speeds has no layer."""
        return np.zeros(self.force.shape[0])

    def take(self, index: IndexArray, piece: IndexArray) -> ScaledTable:
        """See :class:`ScaledLaw`."""
        return ScaledTable(
            self.force[index],
            self.speed[index],
            self.reference,
            self.top[index],
            self.left,
            self.cubic,
            piece,
        )

    def _local(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        v = self.speed * (self.reference + z)
        return v - self.left[self.piece][:, None], self.cubic[:, self.piece][:, :, None]

    def rise(self, z: FloatArray) -> FloatArray:
        """See :class:`ScaledLaw`."""
        t, c = self._local(z)
        rise: FloatArray = self.force * ((self.top - c[3]) - t * (c[2] + t * (c[1] + t * c[0])))
        return rise

    def slope(self, z: FloatArray) -> FloatArray:
        """See :class:`ScaledLaw`."""
        t, c = self._local(z)
        slope: FloatArray = -self.force * self.speed * (c[2] + t * (2.0 * c[1] + t * 3.0 * c[0]))
        return slope


@dataclass(frozen=True, slots=True)
class ScaledGeneral:
    """Any other law, continued below the contact along its tangent."""

    law: FrictionLaw
    force: FloatArray
    speed: FloatArray
    reference: float
    top: FloatArray

    @property
    def pieces(self) -> None:
        """Unknown: the step control has to find its way across kinks."""
        return

    @property
    def jump(self) -> FloatArray:
        """See :class:`ScaledLaw`."""
        moving = float(self.law.coefficient(ALMOST_REST))
        return self.force[:, 0] * (breakaway(self.law) - moving)

    @property
    def grain(self) -> FloatArray:
        """See :class:`ScaledLaw`."""
        grain: FloatArray = _GRAIN * (self.force * self.top)[:, 0]
        return grain

    @property
    def sharpness(self) -> FloatArray:
        """Unknown."""
        return np.zeros(self.force.shape[0])

    def take(self, index: IndexArray, piece: IndexArray) -> ScaledGeneral:
        """See :class:`ScaledLaw`."""
        return ScaledGeneral(
            self.law, self.force[index], self.speed[index], self.reference, self.top[index]
        )

    def rise(self, z: FloatArray) -> FloatArray:
        """See :class:`ScaledLaw`."""
        v = self.speed * (self.reference + z)
        lost = self.top - self.law.coefficient(np.maximum(v, ALMOST_REST))
        return self.force * (lost - self.law.slope(ALMOST_REST) * np.minimum(v, 0.0))

    def slope(self, z: FloatArray) -> FloatArray:
        """See :class:`ScaledLaw`."""
        v = np.maximum(self.speed * (self.reference + z), ALMOST_REST)
        return -self.force * self.speed * self.law.slope(v)


def breakaway(law: FrictionLaw) -> float:
    """The coefficient that sticking can carry [-].

    Whatever slow sliding carries, it does too: the set-valued law at rest is Filippov's convex
    hull.
    """
    return max(law.static, float(law.coefficient(ALMOST_REST)))


def _stribeck(law: Stribeck, force: FloatArray, speed: FloatArray, reference: float) -> ScaledLaw:
    gap = force * (law.static - law.kinetic)
    return ScaledStribeck(gap, law.decay * speed, force * law.viscous * speed, reference)


def _table(law: Tabulated, force: FloatArray, speed: FloatArray, reference: float) -> ScaledLaw:
    first = np.array([[0.0], [0.0], [0.0], [law.values[0]]])
    last = np.array([[0.0], [0.0], [0.0], [law.values[-1]]])
    left, parts = np.array(law.speed), [law.cubics, last]
    if law.speed[0] > 0.0:
        left, parts = np.append(0.0, left), [first, *parts]
    top = law.coefficient(speed) if reference else np.full_like(speed, law.static)
    piece = np.searchsorted(left[1:], reference * speed[:, 0], side='right')
    return ScaledTable(force, speed, reference, top, left, np.hstack(parts), piece)


def _general(
    law: FrictionLaw, force: FloatArray, speed: FloatArray, reference: float
) -> ScaledLaw:
    top = law.coefficient(speed) if reference else np.full_like(speed, breakaway(law))
    return ScaledGeneral(law, force, speed, reference, top)


def scaled(law: FrictionLaw, force: FloatArray, speed: FloatArray, reference: float) -> ScaledLaw:
    """A friction law in the units of the exact cycle.

    Args:
        law: The friction law.
        force: ``N / (m omega V)`` > 0, shape (n,).
        speed: ``V`` > 0 [m/s], shape (n,).
        reference: Relative speed in units of ``V`` from which ``z`` is counted, 0 or 1.
    """
    if computes_as(law, Stribeck):
        return _stribeck(law, force[:, None], speed[:, None], reference)
    if computes_as(law, Tabulated):
        return _table(law, force[:, None], speed[:, None], reference)
    return _general(law, force[:, None], speed[:, None], reference)


def starting_piece(law: ScaledLaw, speed: FloatArray, reference: float) -> IndexArray:
    """The smooth piece just above the reference speed, shape (n,)."""
    pieces = law.pieces
    if pieces is None:
        return np.zeros(speed.size, dtype=np.intp)
    return np.searchsorted(pieces, reference * speed, side='right')


def static_force(law: FrictionLaw, force: FloatArray) -> FloatArray:
    """The largest force that sticking can carry, in units of ``m omega V``, shape (n,)."""
    return force * breakaway(law)


def steepest_fall(law: FrictionLaw) -> float:
    """Upper bound of ``-d mu / dv`` [s/m]; ``inf`` at a jump or where it is not known."""
    if computes_as(law, Stribeck):
        return max((law.static - law.kinetic) * law.decay, 0.0) - law.viscous
    if computes_as(law, Coulomb):
        return np.inf if law.static > law.kinetic else 0.0
    return _steepest_fall(law) if computes_as(law, Tabulated) else np.inf


def _steepest_fall(law: Tabulated) -> float:
    """The largest ``-slope`` of the cubics: at an end of one, or at the vertex of its slope."""
    a, b, c, _ = law.cubics
    width = np.diff(law.speed)
    with np.errstate(divide='ignore', invalid='ignore'):
        vertex = np.clip(np.nan_to_num(-b / (3.0 * a)), 0.0, width)
    places = np.stack([np.zeros_like(width), vertex, width])
    # Rounding must not make a cycle impossible.
    return max(float(np.max(-(3.0 * a * places + 2.0 * b) * places - c)), 0.0) * (1.0 + 1e-12)
