# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from stickslip_monitor import jit
from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.lab.calibration.evidence import (
    BIN_NS,
    TelemetryBins,
    VibrationReport,
    cut_dips,
    path_of,
)
from stickslip_monitor.lab.calibration.posterior import (
    BEGIN,
    LOAD_TERM,
    LOG_SPEED,
    RIGHT,
    SPEED,
    STATE,
    WRONG,
    H,
    log_likelihood,
    prior_of,
)
from stickslip_monitor.physics.friction import Stribeck
from stickslip_monitor.physics.oscillator import Bearing

BEARING = Bearing(50.0, 400.0, 2.0e6, Stribeck(0.30, 0.10, 10.0), 0.100)
RPM = BEARING.speed.factor('rpm')
Coast = Callable[..., tuple[TelemetryBins, list[VibrationReport]]]


def point(tau: float = 1.5, tau_e: float = 1.2) -> FloatArray:
    """The reference bearing without blows and without scatter."""
    logs = [math.log(x) for x in (10.0, 200.0, tau, tau_e)]
    return np.array([[*logs, -60.0, -60.0, math.log(6.0)]])


def prior_points(count: int) -> FloatArray:
    prior = prior_of(BEARING)
    random = np.random.default_rng(4)
    return random.multivariate_normal(prior.mean, prior.covariance, count)


def path_from(coast: Coast) -> FloatArray:
    course, reports = coast()
    (dip,) = cut_dips(course, reports, lambda load: np.full(load.shape, 1.0))
    return dip.path


def lasting(rpm: FloatArray, h: float, state: int, sticking: float) -> FloatArray:
    """A path on which one state is reported throughout, without a doubt."""
    path = np.zeros((rpm.size, 8))
    path[:, H], path[:, SPEED], path[:, LOG_SPEED] = h, rpm * RPM, np.log(rpm * RPM)
    path[:, LOAD_TERM], path[:, STATE] = math.log(1000.0), state
    path[0, H], path[0, BEGIN], path[-1, RIGHT] = sticking, 1.0, 1.0
    return path


def test_compiled_it_is_the_same(coast: Coast, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip('numba')
    path, theta = path_from(coast), prior_points(3)
    compiled = log_likelihood(theta, path)
    monkeypatch.setattr(jit, 'has_compiler', lambda: False)
    assert log_likelihood(theta, path) == pytest.approx(compiled, abs=1e-9)


def test_onset_on_a_ramp() -> None:
    # (e^x - 1 - x)/(beta r) = tau with x = beta r t: 10.610330 s at 0.45 rpm/s and x = 0.25.
    rate, seconds, tau = 0.45, 10.610330, 1.444083
    x = 10.0 * rate * RPM * seconds
    assert (math.expm1(x) - x) / (10.0 * rate * RPM) == pytest.approx(tau, rel=1e-6)
    hopf = math.log(5.0) / 10.0 / RPM
    time = np.linspace(0.0, seconds, 2001)
    path = lasting(hopf - rate * time, seconds / 2000.0, state=1, sticking=0.0)
    quiet = log_likelihood(point(tau=tau), path)[0, 0]
    assert math.exp(quiet) == pytest.approx(1.0 - 1.0 / math.e, abs=1e-4)


def test_a_cycle_ends_after_its_time_beyond_the_fold() -> None:
    # Half a step of the first move is inside: the crossing lies between the two bins.
    rpm = np.concatenate([[40.6], np.full(100, 41.0)])
    path = lasting(rpm, 0.01, state=2, sticking=1.0)
    crossing = (40.723091 - 40.6) / 0.4
    beyond = 0.01 * (99.0 + 1.0 - crossing)
    sticking = log_likelihood(point(tau_e=beyond), path)[0, 0]
    assert math.exp(sticking) == pytest.approx(1.0 - 1.0 / math.e, abs=1e-3)


def test_without_trust_a_report_tells_nothing(coast: Coast) -> None:
    course, reports = coast()
    mistrusted = [replace(report, trust=0.0) for report in reports]
    (dip,) = cut_dips(course, mistrusted, lambda load: np.full(load.shape, 1.0))
    value = log_likelihood(prior_points(200), dip.path)
    assert np.ptp(value[:, 0]) < 1e-9
    assert value[:, 1:] == pytest.approx(np.ones((200, 3)))


def report(start: int, end: int, squeal: bool) -> VibrationReport:
    return VibrationReport('aft', start * BIN_NS, end * BIN_NS, squeal, 5.0, 0.9, '')


@pytest.mark.parametrize(
    ('reports', 'chances'),
    [
        # In a dip of 100 s an end that meets quiet does so with a chance of 2 * 5 s / 100 s.
        ([report(0, 40, False), report(40, 70, True), report(70, 100, False)], [0.5, 0.005, 0.5]),
        ([report(0, 40, False), report(40, 70, True)], [0.5, 0.05]),
        ([report(0, 40, False), report(40, 70, True), report(70, 100, True)], [0.5, 0.05, 0.5]),
        # An end at which nobody reports quiet is no coincidence.
        ([report(20, 60, True)], [0.5]),
        ([report(0, 30, False), report(40, 60, True)], [0.5, 0.5]),
        ([report(20, 60, False)], [0.5]),
    ],
)
def test_a_wrong_squeal_is_as_likely_as_its_ends(
    reports: list[VibrationReport], chances: list[float]
) -> None:
    time = np.arange(100) * BIN_NS
    path = path_of(time, np.full(100, 1.0), np.full(100, 1e3), reports, (0, 100 * BIN_NS))
    wrong = path[path[:, RIGHT] > 0.0, WRONG]
    assert wrong == pytest.approx(0.1 * np.array(chances))
    assert np.flatnonzero(path[:, STATE])[0] == reports[0].start_ns // BIN_NS + 5
