# SPDX-License-Identifier: Apache-2.0
"""How probable stick-slip is at an operating point of a bearing with uncertain parameters.

A bearing may differ from its configuration by two factors, ``r`` of all speeds and ``q`` of all
loads: its boundaries are ``r V_F(q N)`` and ``r V_H(q N)``, of any friction law. An error of the
damping, of the fall of friction or of the load cell is one of ``q``; one of the decay is of both. Both
are logarithmic normal. At a speed ``V`` a boundary is a load ``N_b(V)``, from which on stick-slip
can happen or starts by itself, so that with ``x = ln r``

    ``P = sum_k w_k Phi((ln N + b x_k - ln N_b(V e^-x_k)) / sd_k)``

over nodes of ``x``, where ``b x`` is the mean of ``ln q`` at ``x`` and ``sd_k`` what else is
uncertain of it; after a calibration the nodes are of ``ln q``, each with the ``ln r`` that leaves
the fold where it is. The sums are tabulated once: at each speed the load ``a``, the width ``w`` and how
far the probit is off ``(ln N - a)/w``, which is little. The look-ups are plain functions of
numbers and one flat table: they run as they stand for single points, compiled for long recordings.

``scipy.special`` is imported where it is used: a node without tolerances does without its 22 MB.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from stickslip_monitor import jit
from stickslip_monitor.arrays import FloatArray, flatten, restore
from stickslip_monitor.errors import PhysicsError, require_not_negative
from stickslip_monitor.physics import averaging
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import LAWS, Coulomb, FrictionLaw, Stretched, Stribeck, Tabulated
from stickslip_monitor.physics.lubrication import as_measured

QUANTILES = (0.05, 0.5, 0.95)
"""The quantiles of a boundary that are shown beside a probability."""
FOLD, HOPF = 0, 1
"""The two boundaries, as places in a table."""
UNKNOWN_FALL = 0.25
"""Relative standard deviation of ``mu_s - mu_k`` of a law that does not state both."""

# Head of a table: ln V of the first row, rows in one of ln V, number of rows, least and greatest known ln N.
_FIRST, _PER_LOG_SPEED, _ROWS, _LOW, _HIGH, _TABLE = range(6)
# A row: the load, the width, and the corrections of the probit from -_WIDEST to _WIDEST widths off the load.
_LOAD, _WIDTH, _CORRECTIONS = range(3)
_WIDEST = 4
_PER_ROW = _CORRECTIONS + 2 * _WIDEST + 1
# Nodes of ln r, or of ln q, in its standard deviations: 41 normal kernels, each 0.16 wide.
_KERNEL, _REACH = 0.16, 4.0
_NODES_AT = np.linspace(-_REACH, _REACH, 41)
_NODE_WEIGHTS = np.exp(-0.5 * _NODES_AT**2 / (1.0 - _KERNEL**2))
_NODE_WEIGHTS /= _NODE_WEIGHTS.sum()
# The logarithm of a load that no ship has, for a boundary that no load reaches [ln N].
_MAX_LOG_LOAD = 50.0


@dataclass(frozen=True, slots=True)
class Tolerance:
    """Relative standard deviations of what a bearing's configuration states.

    Args:
        damping: Of ``c``.
        static: Of ``mu_s``.
        kinetic: Of ``mu_k``.
        decay: Of ``beta``, or of the speeds of a measured table.
        speed: Of the measured speed.
        load: Of the measured load.
        model_error: Of a boundary's speed, for what the averaged model leaves out.
        scatter: Of a boundary's speed from one passage to the next.

    Raises:
        PhysicsError: One of them is negative or not finite.
    """

    damping: float = 0.0
    static: float = 0.0
    kinetic: float = 0.0
    decay: float = 0.0
    speed: float = 0.0
    load: float = 0.0
    model_error: float = 0.0
    scatter: float = 0.0

    def __post_init__(self) -> None:
        for item in fields(self):
            require_not_negative(f'tolerance.{item.name}', getattr(self, item.name))

    @property
    def is_exact(self) -> bool:
        """Whether nothing is uncertain."""
        return not any(getattr(self, item.name) for item in fields(self))

    @property
    def of_speed(self) -> float:
        """Relative standard deviation of a boundary's speed at one passage, by speed, model and scatter."""
        return math.hypot(self.speed, self.model_error, self.scatter)

    def of_fall(self, law: FrictionLaw) -> float:
        """Return the relative standard deviation of ``mu_s - mu_k``, the fall of friction with speed.

        ``mu_k`` of a table is its least coefficient, of a law that states none 0. A law whose coefficients
        are equal has :data:`UNKNOWN_FALL`, or 0 where both are exact.
        """
        kinetic = _least_coefficient(law)
        fall = abs(law.static - kinetic)
        deviation = math.hypot(self.static * law.static, self.kinetic * kinetic)
        return deviation / fall if fall > 0.0 else UNKNOWN_FALL * (deviation > 0.0)

    def covariance(self, law: FrictionLaw) -> FloatArray:
        """Return the covariance of ``(ln r, ln q)``, shape (2, 2), without what is measured at each point."""
        decay, load_variance = self.decay**2, self.damping**2 + self.of_fall(law) ** 2
        return np.array([[decay, -decay], [-decay, decay + load_variance]])


EXACT = Tolerance()
"""Nothing is uncertain."""


def _least_coefficient(law: FrictionLaw) -> float:
    """Return the least coefficient of sliding that a law states [-]; 0 where it states none."""
    return float(getattr(law, 'kinetic', min(getattr(law, 'values', (0.0,)))))


def move_boundaries(bearing: Bearing, speeds: float, loads: float) -> Bearing:
    """Return a bearing whose boundaries are ``speeds * V_b(loads * N)`` where this one's are ``V_b(N)``.

    Its damping and its kinetic coefficient are the same; the fall of friction and the speeds at which
    it falls change.

    Args:
        bearing: The bearing.
        speeds: Factor > 0 of the boundaries' speeds.
        loads: Factor > 0 of the load.

    Raises:
        PhysicsError: The law is not one that a configuration can name, or cannot be moved so far.
    """
    law, by = bearing.friction, speeds * loads
    kinetic = _least_coefficient(law)
    static = kinetic + by * (law.static - kinetic)
    if isinstance(law, Stribeck | Stretched):
        moved_law = replace(law, static=static, decay=law.decay / speeds, viscous=law.viscous * loads)
        return replace(bearing, friction=moved_law)
    if isinstance(law, Coulomb):
        return replace(bearing, friction=Coulomb(static, kinetic))
    if isinstance(law, Tabulated):
        values = [kinetic + by * (value - kinetic) for value in law.values]
        return replace(bearing, friction=Tabulated([v * speeds for v in law.speed], values))
    raise PhysicsError(f'a calibration needs a friction law among {", ".join(LAWS)}')


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """The distribution of a bearing's boundaries, as probabilities and quantiles.

    Speeds are magnitudes of the journal's surface speed [m/s]; loads are in N. A probability is 0 without
    load, and ``nan`` where the shaft is at rest or an input is not finite; for it speeds below 1 mm/s and
    above 30 m/s count as these. All are of the reference points of :mod:`.lubrication`: those of the bearing
    where friction depends on speed alone.

    Attributes:
        bearing: The one in the middle.
        covariance: Of ``(ln r, ln q)``, shape (2, 2).
        speed: Further relative standard deviation of a boundary's speed, that of a single passage.
        load: Relative standard deviation of a measured load.
        loads: Least and greatest load at which the bearing is known [N]; beyond them a probability is
            nearer to 1/2.
        calibrated: Whether the fold is known far better than either factor, as after a calibration, which
            needs ``loads``: the factors are then followed along the line that leaves it where it is.
        table: What :func:`probit` and :func:`boundary_speed` look up; made with the object.
    """

    bearing: Bearing
    covariance: FloatArray
    speed: float = 0.0
    load: float = 0.0
    loads: tuple[float, float] = (0.0, math.inf)
    calibrated: bool = False
    table: FloatArray = field(init=False, repr=False)
    _numbers: list[float] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, 'table', self._make_table())
        object.__setattr__(self, '_numbers', self.table.tolist())

    @classmethod
    def from_tolerance(cls, bearing: Bearing, tolerance: Tolerance) -> Belief:
        """Make the belief of a bearing's configured values and their tolerances."""
        covariance = tolerance.covariance(bearing.friction)
        return cls(bearing, covariance, tolerance.of_speed, tolerance.load)

    def load_factor(self, p: float) -> float:
        """Return the factor of a load by which a nominal boundary becomes that of the probability ``p``.

        To first order, for a boundary whose load grows in proportion to the speed; 1 for ``p = 0.5``, less
        for a larger one.

        Args:
            p: Probability that a boundary lies above the point; clipped to 1e-9 from 0 and 1.
        """
        from scipy.special import ndtri

        (r, covariance_rq), (_, q) = self._total
        spread = math.sqrt(max(r + 2.0 * covariance_rq + q, 0.0))
        return math.exp(-spread * float(ndtri(min(max(p, 1e-9), 1.0 - 1e-9))))

    def probabilities(self, speed: ArrayLike, load: ArrayLike, share: ArrayLike = 1.0) -> tuple[Any, Any]:
        """Return the probabilities that a stick-slip cycle exists, and that it starts by itself.

        Args:
            speed: Surface speed, of either sign [m/s].
            load: Load [N].
            share: The averaged fold over the fold that decides, > 0; 1 where either is missing. All three
                broadcast.

        Returns:
            Two floats, or two arrays of the broadcast shape; ``nan`` at rest or where speed or load is not
            finite, 0 without a load.
        """
        if isinstance(speed, float) and isinstance(load, float) and isinstance(share, float):
            return stick_slip_probabilities(self._numbers, abs(speed), load, share)
        shape, (v, n, part) = flatten(speed, load, share)
        points, out = np.column_stack([np.abs(v), n, part]), np.empty((v.size, 2))
        _point_loop(fill_probabilities, v.size)(self.table, points, out)
        return restore(out[:, 0], shape), restore(out[:, 1], shape)

    def fold_speed(self, load: ArrayLike, p: float) -> Any:
        """Return the ``p`` quantile of the averaged fold [m/s] at loads [N], of their shape.

        It is 0 for no fold, or one below 1 mm/s, and 30 m/s for one above.

        Raises:
            PhysicsError: ``p`` is not above 0 and below 1.
        """
        return self._boundary_quantile(FOLD, load, p)

    def hopf_speed(self, load: ArrayLike, p: float) -> Any:
        """Return the ``p`` quantile of the Hopf speed [m/s] at loads [N], of their shape.

        It is 0 for no Hopf speed, or one below 1 mm/s, and 30 m/s for one above.

        Raises:
            PhysicsError: ``p`` is not above 0 and below 1.
        """
        return self._boundary_quantile(HOPF, load, p)

    def _boundary_quantile(self, which: int, load: ArrayLike, p: float) -> Any:
        """Return the ``p`` quantile of a boundary's speed [m/s], of the shape of ``load``; 0 without one.

        Args:
            which: :data:`FOLD` or :data:`HOPF`.
            load: Load [N].
            p: Probability that the boundary lies below the speed, between 0 and 1.

        Raises:
            PhysicsError: ``p`` is not above 0 and below 1.
        """
        if not 0.0 < p < 1.0:
            raise PhysicsError(f'p = {p:g} must be between 0 and 1')
        from scipy.special import ndtri

        z = float(ndtri(p))
        if isinstance(load, float):
            return boundary_speed(self._numbers, which, load, z)
        shape, (n,) = flatten(load)
        out = np.empty(n.size)
        _point_loop(fill_speeds, n.size)(self.table, which, n, z, out)
        return restore(out, shape)

    def fold_margins(self, speed: ArrayLike, load: ArrayLike) -> tuple[Any, Any]:
        """Return the 5 % and the 95 % quantile of the fold margin ``V/V_F - 1``; inputs broadcast.

        Args:
            speed: Surface speed, of either sign [m/s].
            load: Load [N].

        Returns:
            Two results of the broadcast shape, the lower margin first; ``inf`` where that quantile of the
            fold is no speed, ``nan`` at rest or where an input is not finite.
        """
        shape, (v, n) = flatten(speed, load)
        is_known = np.isfinite(v) & np.isfinite(n) & (v != 0.0)
        margins = []
        for p in (QUANTILES[2], QUANTILES[0]):
            fold = np.asarray(self.fold_speed(np.where(is_known, n, 0.0), p))
            margin = np.full(v.size, np.inf)
            np.divide(np.abs(v), fold, out=margin, where=fold > 0.0)
            margins.append(restore(np.where(is_known, margin - 1.0, np.nan), shape))
        return margins[0], margins[1]

    @property
    def _total(self) -> FloatArray:
        """Covariance of ``(ln r, ln q)`` with the errors of measured speed and load, shape (2, 2)."""
        return np.asarray(self.covariance) + np.diag([self.speed**2, 0.0]) + self._load_covariance

    @property
    def _load_covariance(self) -> FloatArray:
        """The covariance of ``(ln r, ln q)`` that the error of the measured load adds, shape (2, 2).

        Where friction depends on the load, an error of the load moves the reference point in both.
        """
        lubrication = self.bearing.lubrication
        g = 0.0 if lubrication is None else lubrication.load_exponent
        return self.load**2 * np.outer([g, 1.0 - g], [g, 1.0 - g])

    def _make_table(self) -> FloatArray:
        """Tabulate both boundaries for the look-ups.

        Returns:
            A flat array: a head of ``_TABLE`` numbers, then for the fold and the Hopf boundary each a row of
            ``_PER_ROW`` numbers for each speed.
        """
        # 768 rows from 1 mm/s to 30 m/s keep a probability to 5e-4 (test_probability).
        ln_v = np.linspace(math.log(1e-3), math.log(30.0), 768)
        (low, high), step = self.loads, float(ln_v[1] - ln_v[0])
        log_loads = [math.log(low) if low > 0.0 else -_MAX_LOG_LOAD, min(math.log(high), _MAX_LOG_LOAD)]
        parts = [np.array([ln_v[0], 1.0 / step, ln_v.size, *log_loads])]
        folds, hopfs = (
            _log_boundary_load(of, as_measured(self.bearing), ln_v)
            for of in (averaging.fold_load, averaging.hopf_load)
        )
        nodes = self._nodes_along_fold(ln_v, folds) if self.calibrated else _nodes_along_speeds(self._total)
        parts += [_boundary_rows(self._total, nodes, ln_v, load).ravel() for load in (folds, hopfs)]
        return np.concatenate(parts)

    def _nodes_along_fold(self, ln_v: FloatArray, folds: FloatArray) -> _Nodes:
        """Return nodes whose factors leave the fold in the middle of the known loads where it is.

        Args:
            ln_v: Rising ``ln V``, shape (m,).
            folds: ``ln N`` of the fold at each, shape (m,).
        """
        (r, covariance_rq), (_, q) = self.covariance
        middle = 0.5 * (math.log(self.loads[0]) + math.log(self.loads[1]))
        log_q = _NODES_AT * math.sqrt(q)

        def log_fold(log_load: FloatArray) -> FloatArray:
            """Return ``ln V`` of the fold at ``ln N``, of its shape; the end beyond the table."""
            return np.interp(log_load, folds, ln_v)

        near = log_fold(middle + np.array([-0.02, 0.0, 0.02]))
        slope = float(near[2] - near[0]) / 0.04
        # Covariances of u = ln r + slope ln q, by which the fold is off.
        of_u, with_q = r + 2.0 * slope * covariance_rq + slope * slope * q, covariance_rq + slope * q
        mean = with_q / q if q > 0.0 else 0.0
        reach = _REACH * math.sqrt(r)
        log_r = np.clip(mean * log_q + near[1] - log_fold(middle + log_q), -reach, reach)
        rest = max(of_u - mean * with_q, 0.0)
        of_load = self._load_covariance
        return _Nodes(log_r, log_q, rest + self.speed**2 + of_load[0, 0], of_load[1, 1])


def _log_boundary_load(of: Callable[..., Any], bearing: Bearing, ln_v: FloatArray) -> FloatArray:
    """Return ``ln N`` from which on a boundary lies above each speed, shape of ``ln_v``.

    Args:
        of: ``averaging.fold_load`` or ``averaging.hopf_load``.
        bearing: The bearing.
        ln_v: Rising ``ln V``, shape (m,).

    Returns:
        Never falling; ``_MAX_LOG_LOAD`` where no load has the boundary there. Of a law that falls again, or
        rises first, all speeds below its highest boundary count as inside.
    """
    with np.errstate(all='ignore'):
        load = np.log(np.asarray(of(bearing, np.exp(ln_v)), float))
    load = np.where(np.isnan(load), _MAX_LOG_LOAD, np.clip(load, -_MAX_LOG_LOAD, _MAX_LOG_LOAD))
    above: FloatArray = np.minimum.accumulate(load[::-1])[::-1]
    return above


@dataclass(frozen=True, slots=True, eq=False)
class _Nodes:
    """Nodes of ``(ln r, ln q)``, and the variances that remain about each."""

    log_r: FloatArray  # shape (nodes,)
    log_q: FloatArray  # shape (nodes,)
    r_variance: float
    q_variance: float


def _nodes_along_speeds(total: FloatArray) -> _Nodes:
    """Return nodes of ``ln r``, each with the mean of ``ln q`` given ``ln r``.

    Args:
        total: Covariance of ``(ln r, ln q)``, shape (2, 2).
    """
    (r, covariance_rq), (_, q) = total
    mean = covariance_rq / r if r > 0.0 else 0.0
    log_r = _NODES_AT * math.sqrt(r)
    return _Nodes(log_r, mean * log_r, 0.0, max(q - mean * covariance_rq, 0.0))


def _boundary_rows(total: FloatArray, nodes: _Nodes, ln_v: FloatArray, load: FloatArray) -> FloatArray:
    """Tabulate one boundary: ``ln N``, its width and corrections of the probit at each speed.

    Args:
        total: Covariance of ``(ln r, ln q)``, shape (2, 2).
        nodes: The nodes of the sum.
        ln_v: Rising ``ln V``, shape (m,).
        load: ``ln N`` of the boundary at each, finite, shape (m,).

    Returns:
        These columns in order, shape (m, ``_PER_ROW``).
    """
    from scipy.special import ndtr, ndtri

    (r, covariance_rq), (_, q) = total
    slope, min_variance = np.gradient(load, ln_v), 1e-9**2  # the variance of an exact boundary, to divide by
    width = np.sqrt(np.maximum(slope * slope * r + 2.0 * slope * covariance_rq + q, min_variance))
    columns = np.arange(-_WIDEST, _WIDEST + 1.0)
    log_load = load[:, None] + width[:, None] * columns
    # At each node the load of the boundary, its slope, and what the node's kernel spreads it.
    at = ln_v[:, None] - nodes.log_r
    load_there, steep = np.interp(at, ln_v, load) - nodes.log_q, np.interp(at, ln_v, slope)
    kernel = np.gradient(load_there, _NODES_AT, axis=1) * _KERNEL
    spread = np.sqrt(nodes.q_variance + steep**2 * nodes.r_variance + kernel**2 + min_variance)
    p = np.zeros(log_load.shape)
    for k, share in enumerate(_NODE_WEIGHTS):
        p += share * ndtr((log_load - load_there[:, k : k + 1]) / spread[:, k : k + 1])
    off = ndtri(np.clip(p, 1e-12, 1.0 - 1e-12)) - columns
    return np.column_stack([load, width, np.clip(off, -_WIDEST, _WIDEST)])


def _point_loop(plain: Callable[..., None], size: int) -> Callable[..., None]:
    """Return a loop of this module: compiled from 100,000 points on where numba may be used, else as it is.

    Args:
        plain: The loop.
        size: Number of points.
    """
    if size < 100_000 or not jit.has_compiler():  # fewer do not repay the time of compiling
        return plain
    from stickslip_monitor.physics import probability  # this module

    return jit.compiled(plain.__name__, probability)


def probit(table: Sequence[float], which: int, log_speed: float, log_load: float) -> float:
    """Return ``z`` with ``P = Phi(z)``, the probability that a boundary lies above a speed at a load.

    Args:
        table: :attr:`Belief.table`, or the same as a list.
        which: :data:`FOLD` or :data:`HOPF`.
        log_speed: ``ln V``; outside the table its first or last speed counts.
        log_load: ``ln N``; more than a fifth outside the known loads ``z`` is nearer to 0.
    """
    rows = int(table[_ROWS])
    place = min(max((log_speed - table[_FIRST]) * table[_PER_LOG_SPEED], 0.0), rows - 1.000001)
    row = int(place)
    share = place - row
    at = _TABLE + (which * rows + row) * _PER_ROW
    after = at + _PER_ROW
    rise = table[after + _LOAD] - table[at + _LOAD]
    load = table[at + _LOAD] + rise * share
    width = table[at + _WIDTH] + (table[after + _WIDTH] - table[at + _WIDTH]) * share
    z = (log_load - load) / width
    along = min(max(z + _WIDEST, 0.0), 2.0 * _WIDEST - 1e-9)
    column = int(along)
    part = along - column
    at += _CORRECTIONS + column
    after += _CORRECTIONS + column
    low = table[at] + (table[at + 1] - table[at]) * part
    high = table[after] + (table[after + 1] - table[after]) * part
    z += low + (high - low) * share
    off = max(table[_LOW] - log_load, log_load - table[_HIGH]) - math.log(1.2)
    if off > 0.0:
        # More than a fifth off the known loads it is known less well: 0.2 of ln V an octave, up to 0.5.
        beyond = min(0.2 * off / math.log(2.0), 0.5)
        z /= math.hypot(1.0, rise * table[_PER_LOG_SPEED] * beyond / width)
    return z


def boundary_speed(table: Sequence[float], which: int, load: float, z: float) -> float:
    """Return the speed below which a boundary lies with the probability ``Phi(z)`` [m/s]; 0 for none.

    It lies within the table, to a 40th power of 2 of its length in ``ln V``.

    Args:
        table: :attr:`Belief.table`, or the same as a list.
        which: :data:`FOLD` or :data:`HOPF`.
        load: Load [N]; not above 0 there is no boundary.
        z: Probit of the wanted quantile.
    """
    if not load > 0.0:
        return 0.0
    log_load = math.log(load)
    low = table[_FIRST]
    high = low + (table[_ROWS] - 1.0) / table[_PER_LOG_SPEED]
    if probit(table, which, low, log_load) <= -z:
        return 0.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        if probit(table, which, middle, log_load) > -z:
            low = middle
        else:
            high = middle
    return math.exp(0.5 * (low + high))


def stick_slip_probabilities(
    table: Sequence[float], speed: float, load: float, share: float
) -> tuple[float, float]:
    """Return the probabilities that stick-slip can go on, and that it starts by itself, at one point.

    Args:
        table: :attr:`Belief.table`, or the same as a list.
        speed: Magnitude of the surface speed [m/s].
        load: Load [N].
        share: The averaged fold over the fold that decides, > 0; 1 where either is missing.

    Returns:
        The second is never above the first. Both ``nan`` at rest or where speed or load is not finite; both 0
        without a load.
    """
    if not (0.0 < speed < math.inf and math.isfinite(load)):
        return math.nan, math.nan
    if load <= 0.0:
        return 0.0, 0.0
    log_speed, log_load = math.log(speed), math.log(load)
    can = _normal_cdf(probit(table, FOLD, log_speed + math.log(share), log_load))
    return can, min(_normal_cdf(probit(table, HOPF, log_speed, log_load)), can)


def _normal_cdf(z: float) -> float:
    """Return the probability of a standard normal number below ``z``."""
    return 0.5 * math.erfc(-z * math.sqrt(0.5))


def update_running_probability(before: float, can: float, will: float) -> float:
    """Return the probability that stick-slip runs now, with the memory of the bistable range.

    ``min(max(before, will), can)``, if all possible bearings pass their boundaries in one order.

    Args:
        before: The same probability at the last point, 0 at the start.
        can: Probability that stick-slip can go on here; ``nan`` changes nothing.
        will: Probability that it starts by itself here; ``nan`` changes nothing.
    """
    after = before if math.isnan(will) else max(before, will)
    return after if math.isnan(can) else min(after, can)


def fill_probabilities(table: Any, points: Any, out: Any) -> None:
    """Fill ``out``, shape (n, 2), with :func:`stick_slip_probabilities` of points.

    Args:
        table: :attr:`Belief.table`.
        points: Rows of speed magnitude [m/s], load [N] and share, shape (n, 3).
        out: Changed in place.
    """
    for k in range(points.shape[0]):
        out[k, 0], out[k, 1] = stick_slip_probabilities(table, points[k, 0], points[k, 1], points[k, 2])


def fill_speeds(table: Any, which: int, load: Any, z: float, out: Any) -> None:
    """Fill ``out``, shape (n,), with :func:`boundary_speed` of loads.

    Args:
        table: :attr:`Belief.table`.
        which: :data:`FOLD` or :data:`HOPF`.
        load: Loads, shape (n,) [N].
        z: Probit of the wanted quantile.
        out: Changed in place [m/s].
    """
    for k in range(load.shape[0]):
        out[k] = boundary_speed(table, which, load[k], z)
