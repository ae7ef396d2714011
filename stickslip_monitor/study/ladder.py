# SPDX-License-Identifier: Apache-2.0
"""The ladder: every way to the amplitude of the stick-slip cycle, from cheap to exact."""

from __future__ import annotations

from stickslip_monitor.study.methods.averaging import Averaging
from stickslip_monitor.study.methods.event_driven import EventDriven, Follow
from stickslip_monitor.study.methods.exact import ExactCycle
from stickslip_monitor.study.methods.harmonic_balance import HarmonicBalance
from stickslip_monitor.study.methods.method import Method
from stickslip_monitor.study.methods.polynomial import PolynomialAveraging
from stickslip_monitor.study.methods.regularised import Regularised
from stickslip_monitor.study.methods.slip_perturbation import SlipPerturbation
from stickslip_monitor.study.methods.surface import Surface
from stickslip_monitor.study.methods.switching import Switching
from stickslip_monitor.study.methods.thomsen_fidlin import ThomsenFidlin

BASE = Averaging()
"""The method whose time others are compared with."""

AT_ONCE = 1000
ORDERS = (3, 5, 9, 15)
HARMONICS = (1, 3, 7, 15, 31, 63)
WIDTHS = (1e-3, 1e-4, 1e-5)


def ladder(follow: Follow) -> tuple[Method, ...]:
    """All methods, in the order of the tables.

    Args:
        follow: Follows a motion in time, for the event-driven integrator.
    """
    methods: list[Method] = [BASE, Averaging(AT_ONCE)]
    methods += [PolynomialAveraging(order) for order in ORDERS]
    methods += [ThomsenFidlin(), SlipPerturbation(), SlipPerturbation(AT_ONCE)]
    methods += [HarmonicBalance(harmonics) for harmonics in HARMONICS]
    methods += [Regularised(width, tight) for tight in (False, True) for width in WIDTHS]
    methods += [Switching(False), Switching(True), Switching(True, 0.1)]
    methods += [EventDriven(follow), ExactCycle(), ExactCycle(AT_ONCE)]
    methods += [Surface(), Surface(AT_ONCE)]
    return tuple(methods)
