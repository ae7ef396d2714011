# SPDX-License-Identifier: Apache-2.0
"""One step of a slip phase, by collocation at Gauss points, for many independent motions at once.

In units of the journal's speed ``V`` and of ``1/omega``, with ``z`` the relative speed counted
from a reference and ``e`` the displacement counted from where ``z' = 0`` at ``z = 0``,

    e' = drift - z        z' = e - 2 zeta z + rise(z)

(drift 1: slip from the breakaway; 0: motion about steady sliding; -1: the lining overtakes the
belt). The solution over a step is a polynomial in the time, found by Picard's iteration and,
where that does not contract, by Newton's. The ends of a step converge with twice the order of
its polynomial: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.7.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from stickslip_monitor.arrays import FloatArray, IndexArray
from stickslip_monitor.physics.cycle.law import ScaledLaw

NODES = 16
# Relative size of the last coefficients of the polynomial at which a step is accepted.
TOLERANCE = 1e-12
# The same of the friction alone: a thin layer moves little, but it feeds the whole cycle.
_FRICTION_TOLERANCE = 1e-9
_PICARD, _LIMIT = 18, 30
_CONVERGED = 1e-15
_NOTHING = 1e-300
# A multiple of the rows that any linear algebra library takes together.
_ROWS = 16


def _tables() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Nodes on [-1, 1], their values to Legendre coefficients, coefficients to the integral's."""
    gauss = legendre.leggauss(NODES)
    nodes, weights = np.asarray(gauss[0], dtype=float), np.asarray(gauss[1], dtype=float)
    orders = np.arange(NODES)
    modal = (legendre.legvander(nodes, NODES - 1) * weights[:, None]).T * (orders + 0.5)[:, None]
    integral = np.zeros((NODES + 1, NODES))
    integral[:2, 0] = 1.0
    for k in range(1, NODES):
        integral[k + 1, k] = 1.0 / (2 * k + 1)
        integral[k - 1, k] = -1.0 / (2 * k + 1)
    return nodes, modal, integral


_NODES, _MODAL, _INTEGRAL = _tables()
# Values at the nodes to coefficients of the integral from -1, and to its values at the nodes.
_TO_INTEGRAL = (_INTEGRAL @ _MODAL).T.copy()
_QUADRATURE = _TO_INTEGRAL @ legendre.legvander(_NODES, NODES).T
_TAIL = _MODAL[-2:].T.copy()
_SQUARE = (_QUADRATURE @ _QUADRATURE).T.copy()
_LINEAR = _QUADRATURE.T.copy()
SAMPLES = np.linspace(-1.0, 1.0, 4 * NODES + 1)[1:]
_AT_SAMPLES = legendre.legvander(SAMPLES, NODES).T.copy()


@dataclass(frozen=True, slots=True)
class SlipMotion:
    """The equations of a set of independent slip phases.

    Attributes:
        law: Their friction, in the units of this module.
        damping: Damping ratio ``zeta``, shape (n,).
        drift: 1, 0 or -1; the same for all.
    """

    law: ScaledLaw
    damping: FloatArray
    drift: float

    def take(self, index: IndexArray, piece: IndexArray) -> SlipMotion:
        """The equations of some of the motions, each on a smooth piece of the law."""
        return SlipMotion(self.law.take(index, piece), self.damping[index], self.drift)

    def kept(self, keep: NDArray[np.bool_], piece: IndexArray) -> SlipMotion:
        """The equations of the motions that are kept; ``piece`` is that of all."""
        return self.take(np.flatnonzero(keep), piece[keep])


@dataclass(frozen=True, slots=True)
class SlipStep:
    """The collocation polynomials of one step; nodes along the last axis.

    Attributes:
        e: Displacement at the nodes, shape (n, nodes).
        z: Relative speed at the nodes.
        rise: Friction lost at the nodes.
        rate: ``z'`` at the nodes.
        error: Size of the last coefficients against the solution; ``inf`` without convergence.
        iterations: Evaluations of the law at all nodes, shape (n,).
    """

    e: FloatArray
    z: FloatArray
    rise: FloatArray
    rate: FloatArray
    error: FloatArray
    iterations: IndexArray


def _times(rows: FloatArray, matrix: FloatArray) -> FloatArray:
    """``rows @ matrix``, in which no row sees how many there are.

    Linear algebra libraries take the last rows, short of a block, in another order of sums.
    """
    short = -rows.shape[0] % _ROWS
    if not short:
        return rows @ matrix
    padded = np.concatenate([rows, np.zeros((short, rows.shape[1]))])
    product: FloatArray = (padded @ matrix)[: rows.shape[0]]
    return product


def _guess(motion: SlipMotion, e: FloatArray, z: FloatArray, h: FloatArray) -> FloatArray:
    column = z[:, None]
    damping = motion.damping[:, None]
    start = e[:, None] - 2.0 * damping * column + motion.law.rise(column)
    slope: FloatArray = motion.law.slope(column) - 2.0 * damping
    time = 0.5 * h[:, None] * (_NODES + 1.0)
    turn = motion.drift - column + slope * start
    guess: FloatArray = column + time * (start + 0.5 * time * turn)
    return guess


def _newton(
    motion: SlipMotion, z: FloatArray, half: FloatArray, residual: FloatArray
) -> FloatArray:
    """The correction ``J^-1 residual``; ``nan`` where the matrices cannot be solved."""
    slope: FloatArray = motion.law.slope(z) - 2.0 * motion.damping[:, None]
    deep = half[:, :, None]
    matrix = np.eye(NODES) + deep * deep * _SQUARE - deep * _LINEAR * slope[:, None, :]
    try:
        solved = np.asarray(np.linalg.solve(matrix, residual[:, :, None]), dtype=float)
    except np.linalg.LinAlgError:
        # No motion may see that the matrix of another is singular.
        solved = np.full((*residual.shape, 1), np.nan)
        for i, own in enumerate(residual):
            with suppress(np.linalg.LinAlgError):
                solved[i, :, 0] = np.linalg.solve(matrix[i], own)
    correction: FloatArray = solved[:, :, 0]
    return correction


def solve_step(
    motion: SlipMotion, piece: IndexArray, e: FloatArray, z: FloatArray, h: FloatArray
) -> SlipStep:
    """Solve the collocation equations of one step for every motion.

    Args:
        motion: The equations of n motions.
        piece: Smooth piece of the law each is on, shape (n,).
        e: Displacement at the start, shape (n,).
        z: Relative speed at the start, shape (n,).
        h: Length of the step, positive or negative, shape (n,).
    """
    table = np.empty((4, z.size, NODES))
    unsolved, none = np.full(z.size, np.inf), np.zeros(z.size, dtype=np.intp)
    out = SlipStep(table[0], table[1], table[2], table[3], unsolved, none)
    half, e0, z0 = 0.5 * h[:, None], e[:, None], z[:, None]
    with np.errstate(over='ignore', invalid='ignore'):
        guess = _guess(motion, e, z, h)
        index, nodes = np.arange(z.size), guess
        for count in range(_LIMIT):
            damping = motion.damping[:, None]
            rise = motion.law.rise(nodes)
            offset = e0 + half * _times(motion.drift - nodes, _QUADRATURE)
            rate = offset - 2.0 * damping * nodes + rise
            change = z0 + half * _times(rate, _QUADRATURE) - nodes
            if count >= _PICARD:
                change = _newton(motion, nodes, half, change)
            nodes = nodes + change
            forces = np.max(np.abs(offset) + np.abs(rise), axis=1)
            scale = np.max(np.abs(nodes), axis=1) + 2.0 * np.abs(half[:, 0]) * forces
            moving = ~(np.max(np.abs(change), axis=1) <= _CONVERGED * scale)
            if not moving.all():
                done = ~moving
                where = index[done]
                out.e[where], out.z[where] = offset[done], nodes[done]
                out.rise[where], out.rate[where] = rise[done], rate[done]
                tail = np.max(np.abs(_times(rate[done], _TAIL)), axis=1)
                layer = np.max(np.abs(_times(rise[done], _TAIL)), axis=1)
                size = np.max(np.abs(rise[done]), axis=1) + motion.law.grain[done] + _NOTHING
                out.error[where] = np.maximum(
                    2.0 * np.abs(half[done, 0]) * tail / scale[done],
                    TOLERANCE / _FRICTION_TOLERANCE * layer / size,
                )
                out.iterations[where] = count + 1
                if not moving.any():
                    break
                motion = motion.kept(moving, piece)
                index, nodes, piece = index[moving], nodes[moving], piece[moving]
                half, e0, z0 = half[moving], e0[moving], z0[moving]
            if count == _PICARD - 1:
                nodes = guess[index]
        else:
            out.iterations[index] = _LIMIT
    return out


def integral(start: FloatArray | float, values: FloatArray, h: FloatArray) -> FloatArray:
    """Legendre coefficients of ``start + integral`` of nodal values, shape (n, nodes + 1)."""
    series = 0.5 * h[:, None] * _times(values, _TO_INTEGRAL)
    series[:, 0] += start
    return series


def value(x: FloatArray, series: FloatArray) -> FloatArray:
    """A Legendre series of each row at its own ``x`` in [-1, 1] (Clenshaw), shape (n,)."""
    if (x == 1.0).all():
        whole: FloatArray = series.sum(axis=1)
        return whole
    c0, c1 = series[:, -2], series[:, -1]
    for k in range(series.shape[1] - 1, 1, -1):
        c0, c1 = series[:, k - 2] - c1 * ((k - 1) / k), c0 + c1 * x * ((2 * k - 1) / k)
    return c0 + c1 * x


def at_samples(series: FloatArray) -> FloatArray:
    """A Legendre series at the ``SAMPLES``, shape (n, samples)."""
    values: FloatArray = np.einsum('nk,ks->ns', series, _AT_SAMPLES)
    return values
