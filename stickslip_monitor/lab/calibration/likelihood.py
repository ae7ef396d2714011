# SPDX-License-Identifier: Apache-2.0
"""How probable the reports of a dip are, given the bearing: a filter of two hidden states.

Quiet and sticking change with probabilities that follow from the path of speed and load alone.
With ``v = beta V``, ``d = ln(N/N0) - ln(1 + nu N/c)`` and the fold at ``d = D(v)``:

* beyond the fold a cycle survives the time ``E`` spent there with
  ``S_e = 1 - exp(-exp(-4 (E/tau_e - 1)))``; back inside, ``E`` is given back second by second;
* in the bistable range, ``x = (v - d)/(v - D(v))`` of the way from the Hopf speed to the fold,
  blows begin a cycle at the rate ``lambda exp(-4 x)`` and end one at ``lambda exp(-4 (1 - x))``;
* while steady sliding is unstable noise grows, ``G += (exp(d - v) - 1) h/tau``, and has not yet
  become stick-slip with ``S = 1 - exp(-exp(-2 L (G - 1)))``, ``L = 6``: the Gumbel law that a
  Rayleigh distributed envelope gives. In the bistable range ``G`` falls again at its own rate.

A report is either right, and then the state that contradicts it never ran in its core, or, with a
small probability, worthless. Every dip has a boundary of its own: ``ln beta`` shifted by ``s z``
with ``z ~ N(0, 1)``.
"""

from __future__ import annotations

import functools
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.lab.calibration import two_states
from stickslip_monitor.physics.averaging.dimensionless import decline

PARAMETERS = ('ln_beta', 'ln_n0', 'ln_tau', 'ln_tau_e', 'ln_lambda', 'ln_s')
"""Names of a point's coordinates; ``beta`` [s/m], ``N0`` [N], ``tau`` [s], ``tau_e`` [s],
``lambda`` [1/s], ``s`` [-]."""

H, SPEED, LOG_SPEED, LOAD_TERM, STATE, BEGIN, RIGHT, WRONG = range(8)
"""The columns of a dip's path, see :func:`two_states.log_likelihoods`."""

_NODES = np.linspace(-2.6, 2.6, 9)
_WEIGHTS = np.exp(-0.5 * _NODES**2) / np.exp(-0.5 * _NODES**2).sum()
_FIRST, _LAST, _PER_LOG = -9.0, 7.0, 500.0
_LEAST = 1e-300
_CHUNK = 512


@functools.cache
def decline_table() -> FloatArray:
    """First ``ln v``, points for each unit of it, then ``D(v)``."""
    logs = np.linspace(_FIRST, _LAST, round((_LAST - _FIRST) * _PER_LOG) + 1)
    return np.concatenate([[_FIRST, _PER_LOG], decline(np.exp(logs))])


@dataclass(frozen=True, slots=True)
class Likelihood:
    """Log likelihoods of dips.

    Attributes:
        compiled: Whether numba compiles the inner loop; by default where it is installed.
    """

    compiled: bool | None = None

    def of_dip(self, theta: FloatArray, path: FloatArray) -> FloatArray:
        """Log likelihood of one dip's reports, and how doubtful each report is.

        Args:
            theta: Points, :data:`PARAMETERS`, shape (n, 6).
            path: The dip, shape (bins, 8).

        Returns:
            Shape (n, 1 + reports): the logarithm, then for each report the probability, after
            all that came before it, that it is worthless.
        """
        reports = int(np.count_nonzero((path[:, RIGHT] > 0.0) | (path[:, WRONG] > 0.0)))
        out = np.zeros((theta.shape[0], 1 + reports))
        if not reports:
            return out
        installed = find_spec('numba') is not None
        if installed if self.compiled is None else self.compiled:
            _compiled()(theta, _NODES, _WEIGHTS, path, decline_table(), out)
        else:
            for start in range(0, theta.shape[0], _CHUNK):
                out[start : start + _CHUNK] = _with_arrays(theta[start : start + _CHUNK], path)
        return out

    def of_dips(
        self,
        theta: FloatArray,
        paths: Sequence[FloatArray],
        progress: Callable[[], None] | None = None,
    ) -> FloatArray:
        """Log likelihood of each dip, shape (n, dips)."""
        result = np.empty((theta.shape[0], len(paths)))
        for k, path in enumerate(paths):
            result[:, k] = self.of_dip(theta, path)[:, 0]
            if progress is not None:
                progress()
        return result


@functools.cache
def _compiled() -> Callable[..., None]:
    try:
        return _compile(cache=True)
    except RuntimeError:  # numba has no folder that it may write to
        return _compile(cache=False)


def _compile(cache: bool) -> Callable[..., None]:
    """Compile copies of the functions that call each other, so that the plain ones stay."""
    jit = import_module('numba').njit(cache=cache)
    space: dict[str, Any] = dict(vars(two_states))
    # numba does not see when a function that a cached one calls has changed.
    digest = f'{zlib.crc32(Path(str(two_states.__file__)).read_bytes()):08x}'
    for name, function in list(space.items()):
        if isinstance(function, FunctionType):
            copy = FunctionType(function.__code__, space, name)
            copy.__qualname__ = f'{name}_{digest}'
            space[name] = jit(copy)
    return space['log_likelihoods']


def _with_arrays(theta: FloatArray, path: FloatArray) -> FloatArray:
    """:func:`two_states.log_likelihoods` with an array operation in place of each number's."""
    filtered = _Filter(theta)
    with np.errstate(all='ignore'):
        for t, row in enumerate(path):
            if t == 0:
                filtered.begin(row)
            else:
                filtered.move(row)
            if row[STATE]:
                filtered.take(row)
    best = filtered.result.max(axis=1, keepdims=True)
    share = _WEIGHTS * np.exp(filtered.result - best)
    total = share.sum(axis=1)
    doubts = [(share * doubt).sum(axis=1) / total for doubt in filtered.doubts]
    return np.column_stack([best[:, 0] + np.log(total), *doubts])


class _Filter:
    """The states of all points and nodes, each array of shape (points, nodes)."""

    def __init__(self, theta: FloatArray) -> None:
        column = theta[:, :, None]
        self.log_beta = column[:, 0] + np.exp(column[:, 5]) * _NODES
        self.beta = np.exp(self.log_beta)
        shape = self.beta.shape
        self.log_load = column[:, 1]
        self.tau, self.tau_e, self.rate = (np.exp(column[:, k]) for k in (2, 3, 4))
        self.spent, self.growth, self.most, self.result = (np.zeros(shape) for _ in range(4))
        self.doubts: list[FloatArray] = []

    def _place(self, row: FloatArray) -> None:
        self.v = self.beta * row[SPEED]
        self.d = row[LOAD_TERM] - self.log_load
        table = decline_table()
        place = np.clip((self.log_beta + row[LOG_SPEED] - table[0]) * table[1], 0, table.size - 4)
        index = place.astype(np.intp)
        low = table[2 + index]
        self.value = low + (place - index) * (table[3 + index] - low)
        self.excess = self.value - self.d

    def begin(self, row: FloatArray) -> None:
        """The first bin."""
        self._place(row)
        self.sticking = np.where(self.excess < 0.0, row[H], 0.0)
        self.quiet = 1.0 - self.sticking
        self.quiet_c, self.sticking_c = self.quiet, self.sticking
        self.before = self.excess
        self.pace = np.exp(np.minimum(self.d - self.v, 50.0)) - 1.0

    def move(self, row: FloatArray) -> None:
        """From one bin to the next."""
        self._place(row)
        on, off = self._changes(row[H])
        self.before = self.excess
        move = self.quiet * on - self.sticking * off
        self.quiet, self.sticking = self.quiet - move, self.sticking + move
        move = self.quiet_c * on - self.sticking_c * off
        self.quiet_c, self.sticking_c = self.quiet_c - move, self.sticking_c + move

    def _changes(self, h: float) -> tuple[FloatArray, FloatArray]:
        """Probabilities that a cycle begins and that one ends in this bin."""
        out = self.excess >= 0.0
        part = np.where(self.before >= 0.0, h, h * self.excess / (self.excess - self.before))
        old = self.spent
        self.spent = np.where(out, old + part, np.maximum(0.0, old - h))
        ended = 1.0 - _end_survival(self.spent / self.tau_e) / _end_survival(old / self.tau_e)
        ended = np.where(self.spent > 3.0 * self.tau_e, 1.0, ended)
        stay = self._grow(h, out)
        x = np.clip((self.v - self.d) / (self.v - self.value), 0.0, 1.0)
        unstable = self.d > self.v
        on = 1.0 - stay * np.exp(-self.rate * h * np.where(unstable, 1.0, np.exp(-4.0 * x)))
        off = -np.expm1(-self.rate * np.exp(-4.0 * (1.0 - x)) * h)
        return np.where(out, 0.0, on), np.where(out, ended, np.where(unstable, 0.0, off))

    def _grow(self, h: float, out: NDArray[np.bool_]) -> FloatArray:
        """Let noise grow or decay; the probability that it is noise still."""
        new = np.where(out, -1.0, np.exp(np.minimum(self.d - self.v, 50.0)) - 1.0)
        growth = np.maximum(0.0, self.growth + 0.5 * (self.pace + new) * h / self.tau)
        self.growth, self.pace = np.where(out, 0.0, growth), new
        most = np.where(self.growth == 0.0, 0.0, np.maximum(self.most, self.growth))
        before = _onset_survival(self.most)
        stay = np.where(before > _LEAST, _onset_survival(most) / before, 0.0)
        grown = most > np.where(self.growth == 0.0, 0.0, self.most)
        self.most = most
        return np.where(grown, stay, 1.0)

    def take(self, row: FloatArray) -> None:
        """What a running report says of this bin, and its end."""
        if row[BEGIN]:
            self.quiet_c, self.sticking_c = self.quiet, self.sticking
        if row[STATE] == two_states.QUIET:
            self.sticking_c = np.zeros_like(self.sticking_c)
        else:
            self.quiet_c = np.zeros_like(self.quiet_c)
        right, wrong = row[RIGHT], row[WRONG]
        if right > 0.0 or wrong > 0.0:
            alternative = wrong * (self.quiet + self.sticking)
            quiet = right * self.quiet_c + wrong * self.quiet
            sticking = right * self.sticking_c + wrong * self.sticking
            total = np.maximum(quiet + sticking, _LEAST)
            self.result = self.result + np.log(total)
            self.quiet, self.sticking = quiet / total, sticking / total
            self.doubts.append(alternative / total)


def _end_survival(share: FloatArray) -> FloatArray:
    return -np.expm1(-np.exp(-two_states.END_SHAPE * (share - 1.0)))


def _onset_survival(growth: FloatArray) -> FloatArray:
    return -np.expm1(-np.exp(-2.0 * two_states.NOISE_FOLDS * (growth - 1.0)))
