# SPDX-License-Identifier: Apache-2.0
"""``scipy.integrate.solve_ivp`` as the methods that use it do."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from stickslip_monitor.physics.friction import Array

Flow = Callable[[float, Array], tuple[float, float]]
Event = Callable[[float, Array], float]

_solve_ivp: Any = solve_ivp


@dataclass(frozen=True, slots=True)
class Run:
    """What is needed of a run.

    Attributes:
        good: Whether it came to its end or to a terminal event.
        evaluations: Of the flow.
        turn_times: When the velocity vanished, shape (n,) [s].
        turns: Displacement there, shape (n,) [m].
        time: At the end [s].
        x: Displacement at the end [m].
    """

    good: bool
    evaluations: int
    turn_times: Array
    turns: Array
    time: float
    x: float


def run(
    flow: Flow,
    span: tuple[float, float],
    start: tuple[float, float],
    more: Sequence[Event] = (),
    **options: Any,
) -> Run:
    """Integrate from a displacement [m] and a velocity [m/s].

    Args:
        flow: ``(x', x'')`` of time and ``(x, x')``.
        span: Begin and end [s].
        start: ``x`` and ``x'`` at the begin.
        more: Events besides the turning points.
        options: Handed to ``solve_ivp``.
    """
    found = _solve_ivp(flow, span, list(start), events=[_velocity, *more], **options)
    turns = np.asarray(found.y_events[0], dtype=float).reshape(-1, 2)[:, 0]
    return Run(
        good=bool(found.success),
        evaluations=int(found.nfev),
        turn_times=np.asarray(found.t_events[0], dtype=float),
        turns=turns,
        time=float(found.t[-1]),
        x=float(found.y[0, -1]),
    )


def _velocity(_: float, y: Array) -> float:
    return float(y[1])
