# SPDX-License-Identifier: Apache-2.0
"""The truth about the operating point: speed, load and margins without any sensor.

``{rate, bearing}``
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from stickslip_monitor.monitor.assessment import margin
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.physics.bifurcation import fold_speed, hopf_speed
from stickslip_monitor.scenes.block import Block
from stickslip_monitor.scenes.friction_course import STEP, FrictionCourse
from stickslip_monitor.scenes.settings import Settings
from stickslip_monitor.scenes.signals import FloatArray
from stickslip_monitor.scenes.truth import FLOAT64, Column, topic

from .effect import Frame

KEYS = ('bearing', 'rate')
_HIGHEST_RATE = 1000.0
# The last digits of an exponential differ between processors, and recordings must not.
_DIGITS = 9


@dataclass(frozen=True, slots=True)
class OperatingPoint:
    """Tells the operating points of some bearings, each with the course of its friction."""

    rate: float
    bearings: list[tuple[BearingConfig, FrictionCourse]]

    def apply(self, block: Block) -> None:
        """Tell those of a block."""
        time = block.instants(self.rate)
        for config, course in self.bearings:
            speed, load = block.shaft.speed(config.name, time), block.shaft.load(config.name, time)
            hopf, fold = _margins(config, course, time, speed, load)
            values = {'speed': speed, 'load': load, 'hopf_margin': hopf, 'fold_margin': fold}
            block.truth.extend(
                Column(topic(config.name, name), FLOAT64, time, value)
                for name, value in values.items()
            )


def _margins(
    config: BearingConfig,
    course: FrictionCourse,
    time: FloatArray,
    speed: FloatArray,
    load: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Hopf and fold margin by the friction that there really is, each shape (n,)."""
    step = time // STEP if course.moves else np.zeros(time.size)
    felt = load * course.factor_at(time)
    edges = [0, *(np.flatnonzero(np.diff(step)) + 1).tolist(), time.size]
    hopf, fold = np.empty(time.size), np.empty(time.size)
    for low, high in pairwise(edges):
        if low < high:
            bearing = replace(config.bearing, friction=course.shape_at(float(time[low])))
            hopf[low:high] = hopf_speed(bearing, felt[low:high])
            fold[low:high] = fold_speed(bearing, felt[low:high])
    return _rounded(margin(np.abs(speed), hopf)), _rounded(margin(np.abs(speed), fold))


def _rounded(margins: FloatArray) -> FloatArray:
    return np.asarray(np.round(margins, _DIGITS))


def build(settings: Settings, frame: Frame) -> OperatingPoint:
    """Build the effect."""
    rate = settings.number('rate', 'Hz', above=0.0, most=_HIGHEST_RATE)
    bearings = frame.bearings(settings)
    return OperatingPoint(rate, [(config, frame.course(config)) for config in bearings])
