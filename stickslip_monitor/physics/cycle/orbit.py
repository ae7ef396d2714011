# SPDX-License-Identifier: Apache-2.0
"""Orbits of the slip phase, followed from event to event, many at once."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray
from stickslip_monitor.physics.cycle.events import pass_events
from stickslip_monitor.physics.cycle.setting import OrbitFrame, Orbits, Setting, Stretch
from stickslip_monitor.physics.cycle.slip_step import (
    NODES,
    TOLERANCE,
    SlipStep,
    integral,
    solve_step,
)

_STEPS = 4000
# Orbits followed together: arrays that stay in the cache, and products of matrices too small for
# a linear algebra library to start its threads, which costs more than it gains.
_BLOCK = 512
_LONGEST, _SHORTEST = 1.0, 1e-13
_GROWTH, _SHRINK = 2.5, 0.2
# Folds above the layer of a sharp law from which a step may enter it, and how far it may go down
# at a time from further above: between two nodes the layer would not be seen.
_IN_SIGHT, _DOWN = 40.0, 0.25


def follow(
    frame: OrbitFrame,
    setting: Setting,
    e: FloatArray,
    z: FloatArray,
    record: list[Stretch] | None = None,
) -> Orbits:
    """Follow orbits until each has ended.

    Args:
        frame: What they start from and what ends them.
        setting: What they move in.
        e: Displacement at the start, shape (n,).
        z: Relative speed at the start, shape (n,).
        record: Takes every accepted step.
    """
    if e.size <= _BLOCK:
        return _follow(frame, setting, e, z, record)
    cuts = [slice(start, start + _BLOCK) for start in range(0, e.size, _BLOCK)]
    parts = [_follow(frame, setting.take(cut), e[cut], z[cut], record) for cut in cuts]
    names = [column.name for column in fields(Orbits)]
    return Orbits(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def _follow(
    frame: OrbitFrame, setting: Setting, e: FloatArray, z: FloatArray, record: list[Stretch] | None
) -> Orbits:
    with np.errstate(over='ignore', invalid='ignore', under='ignore'):
        orbits = _begin(frame, setting, e, z)
        running = np.arange(e.size)
        for _ in range(_STEPS):
            if not running.size:
                break
            running = _advance(frame, setting, orbits, running, record)
    return orbits


def _begin(frame: OrbitFrame, setting: Setting, e: FloatArray, z: FloatArray) -> Orbits:
    n = e.size
    law = setting.motion.take(np.arange(n), setting.piece).law
    rate = np.abs(law.slope(z[:, None])[:, 0]) + 2.0 * setting.motion.damping
    y = frame.drift - z
    return Orbits(
        e=e.copy(),
        z=z.copy(),
        h=0.1 * frame.direction / (1.0 + rate),
        piece=setting.piece.copy(),
        stage=np.full(n, frame.first, dtype=np.intp),
        end=np.zeros(n, dtype=np.intp),
        time=np.zeros(n),
        work=np.zeros(n),
        divergence=np.zeros(n),
        crest=np.full(n, np.nan),
        trough=np.full(n, np.nan),
        margin=np.full(n, -1.0),
        excess=(e - setting.hold) * (e + setting.hold - 2.0 * setting.rest) + (y * y - 1.0),
        energy=(e - setting.rest) ** 2 + y * y,
        evaluations=np.zeros(n, dtype=np.intp),
    )


def _advance(
    frame: OrbitFrame,
    setting: Setting,
    orbits: Orbits,
    running: IndexArray,
    record: list[Stretch] | None,
) -> IndexArray:
    """Try one step of every running orbit and return those that still run."""
    piece, h = orbits.piece[running], orbits.h[running]
    motion = setting.motion.take(running, piece)
    step = solve_step(motion, piece, orbits.e[running], orbits.z[running], h)
    orbits.evaluations[running] += step.iterations
    step.error[_is_blind(frame, motion.law.sharpness, orbits.z[running], step.z)] = np.inf
    # A step far beyond its smooth piece may leave the range of numbers.
    step.error[np.isnan(step.error)] = np.inf
    good = step.error <= TOLERANCE
    with np.errstate(divide='ignore'):
        factor = 0.9 * (TOLERANCE / step.error) ** (1.0 / NODES)
    factor = np.clip(factor, _SHRINK, np.where(good, _GROWTH, 0.6))
    orbits.h[running] = np.clip(h * factor, -_LONGEST, _LONGEST)
    keep = np.abs(orbits.h[running]) > _SHORTEST
    if good.any():
        stretch = _stretch(frame, setting, orbits, step, running, h, good)
        keep[good] &= pass_events(frame, setting, orbits, stretch)
        if record is not None:
            record.append(stretch)
    return running[keep]


def _is_blind(
    frame: OrbitFrame, sharpness: FloatArray, start: FloatArray, nodes: FloatArray
) -> BoolArray:
    """Whether a step comes down towards the layer of a sharp law from where it is not seen."""
    above, low = frame.reference + start, frame.reference + np.min(nodes, axis=1)
    blind: BoolArray = (sharpness * above > _IN_SIGHT) & (low < _DOWN * above)
    return blind


def _stretch(
    frame: OrbitFrame,
    setting: Setting,
    orbits: Orbits,
    step: SlipStep,
    running: IndexArray,
    length: FloatArray,
    good: BoolArray,
) -> Stretch:
    index, h, nodes = running[good], length[good], step.z[good]
    y = frame.drift - nodes
    damping = 2.0 * setting.motion.damping[index][:, None]
    power = y * (setting.pull[index][:, None] - step.rise[good] - damping * y)
    law = setting.motion.law.take(index, orbits.piece[index])
    return Stretch(
        index=index,
        time=orbits.time[index],
        h=h,
        e=integral(orbits.e[index], y, h),
        z=integral(orbits.z[index], step.rate[good], h),
        work=integral(orbits.work[index], power, h),
        divergence=integral(orbits.divergence[index], law.slope(nodes) - damping, h),
    )
