# SPDX-License-Identifier: Apache-2.0
"""The integrator against closed forms and against the numbers of PHYSICS.md.

Short motions run without numba, so that what is tested does not depend on what is installed.
"""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from shared import REFERENCE_BEARING, ROOT

from stickslip_monitor import jit
from stickslip_monitor.errors import PhysicsError
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.cycles import exact_cycle
from stickslip_monitor.physics.friction import Coulomb, Stretched, Stribeck, Tabulated
from stickslip_monitor.physics.integrator import Drive, Motion, MotionOutcome, MotionState, Phase, integrate

LOAD = 1000.0
HAS_NUMBA = find_spec('numba') is not None


def test_coulomb_damper_stops_where_it_must() -> None:
    # A stopped shaft makes half swings about +-mu_k N/k, each shorter, to a stop within mu_s N/k.
    bearing = replace(REFERENCE_BEARING, friction=Coulomb(0.3, 0.25))
    half = math.pi / (bearing.natural_frequency * math.sqrt(1.0 - bearing.damping_ratio**2))
    ratio = math.exp(-bearing.damping_ratio * bearing.natural_frequency * half)
    kinetic, static = (mu * LOAD / bearing.stiffness for mu in (0.25, 0.3))
    x, side, swings = 2.0e-3, 1.0, 0
    while abs(x) > static:
        x, side, swings = side * kinetic - ratio * (x - side * kinetic), -side, swings + 1
    motion = integrate(bearing, Drive.constant(0.0, LOAD, 1.0), MotionState(2.0e-3, 0.0), compiled=False)
    assert motion.transitions.time == pytest.approx(half * np.arange(1, swings + 1), rel=1e-12)
    assert (motion.transitions.after == Phase.STICK).tolist() == [False] * (swings - 1) + [True]
    assert motion.final.displacement == pytest.approx(x, rel=1e-11)
    assert motion.final.phase is Phase.STICK


RISING = replace(REFERENCE_BEARING, friction=Stribeck(0.1, 0.3, 10.0))
POINTS = Tabulated([0.02, 0.1, 0.5], [0.3, 0.15, 0.2])
# Beside the cycles of test_integrator_hard.py.
HARD = {
    'eta 1e-6': (REFERENCE_BEARING, 0.1, 5e-3, None),
    'eta 1e3, released': (REFERENCE_BEARING, 0.1, 5e6, MotionState(0.75 - 3e-5, 0.0)),
    'level law': (replace(REFERENCE_BEARING, friction=Stribeck(0.2, 0.2, 10.0)), 0.1, LOAD, None),
    'rising law': (RISING, 0.1, LOAD, None),
    'rising, eta 1e3': (RISING, 0.1, 5e6, MotionState(0.25, 0.0)),
    'rising Coulomb': (replace(REFERENCE_BEARING, friction=Coulomb(0.1, 0.3)), 0.1, LOAD, None),
    'few points': (replace(REFERENCE_BEARING, friction=POINTS), 0.1, LOAD, None),
    'no load, no speed': (REFERENCE_BEARING, 0.0, 0.0, MotionState(1e-3, 0.0)),
    'nothing at all': (REFERENCE_BEARING, 0.0, 0.0, None),
    'almost denormal': (REFERENCE_BEARING, 0.0, 0.0, MotionState(1e-310, 0.0)),
}


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('name', HARD)
def test_hard_cases_end_and_are_finite(name: str) -> None:
    bearing, speed, load, state = HARD[name]
    drive = Drive.constant(speed, load, 1.0)
    times = np.linspace(0.0, 1.0, 101)
    motion = integrate(bearing, drive, state or MotionState(0.0, 0.0), times, compiled=False)
    assert motion.outcome is MotionOutcome.COMPLETE
    for column in (motion.displacement, motion.velocity, motion.acceleration):
        assert np.isfinite(column).all()
    # About 32 periods of some 50 steps by a method of order 8, and more at the kinks of a table: a
    # bound that only stiffness (rising law, eta = 1000) may come near.
    assert motion.steps < (60_000 if 'eta 1e3' in name else 3_000)
    assert np.all(np.diff(motion.transitions.time) >= 0.0)


def test_rising_coulomb_law_does_not_chatter() -> None:
    # By Filippov's convex hull the lining sticks until the kinetic limit.
    bearing = replace(REFERENCE_BEARING, friction=Coulomb(0.1, 0.3))
    motion = integrate(bearing, Drive.constant(0.05, LOAD, 1.0), MotionState(0.0, 0.0), compiled=False)
    release = (0.3 * LOAD - bearing.damping * 0.05) / bearing.stiffness / 0.05
    assert motion.transitions.time == pytest.approx([release], rel=1e-12)


def test_motion_astern_mirrors_motion_ahead() -> None:
    times = np.linspace(0.0, 0.2, 101)
    grid, speed, load = [0.0, 0.1, 0.2], np.array([0.1, 0.02, 0.15]), [900.0, 1100.0, 700.0]
    ahead, astern = (
        integrate(
            REFERENCE_BEARING,
            Drive.sampled(grid, side * speed, load),
            MotionState(side * 1e-4, 0.0),
            times,
            compiled=False,
        )
        for side in (1.0, -1.0)
    )
    assert np.array_equal(ahead.displacement, -astern.displacement)
    assert np.array_equal(ahead.phase, -astern.phase)


def test_bad_arguments_are_named() -> None:
    drive = Drive.constant(0.1, LOAD, 1.0)
    with pytest.raises(PhysicsError, match=r'times from 0\.5 to 2 s must lie within the drive'):
        integrate(REFERENCE_BEARING, drive, MotionState(0.0, 0.0), [0.5, 2.0])
    with pytest.raises(PhysicsError, match='do not fall'):
        integrate(REFERENCE_BEARING, drive, MotionState(0.0, 0.0), [0.5, 0.2])
    with pytest.raises(PhysicsError, match='must be 0 while the lining sticks'):
        MotionState(0.0, 0.1, Phase.STICK)
    with pytest.raises(PhysicsError, match='accuracy = 0 must be greater than 0'):
        integrate(REFERENCE_BEARING, drive, MotionState(0.0, 0.0), accuracy=0.0)


def test_overflow_is_an_outcome() -> None:
    drive, far = Drive.constant(0.1, LOAD, 1.0), MotionState(1e307, 0.1)
    motion = integrate(REFERENCE_BEARING, drive, far, [0.0, 1.0], compiled=False)
    assert motion.outcome is MotionOutcome.NOT_FINITE
    assert motion.displacement.size == 0


def test_a_held_lining_moves_as_the_straight_lines_of_the_drive_say() -> None:
    times = np.linspace(0.0, 1.0, 21)
    drive = Drive.sampled([0.0, 0.5, 1.0], [0.0, 2e-4, -2e-4], [1000.0] * 3)
    motion = integrate(REFERENCE_BEARING, drive, MotionState(0.0, 0.0), times, compiled=False)
    assert motion.sticking.all()
    first_half = 2e-4 * times**2
    second_half = 5e-5 + 2e-4 * (times - 0.5) - 4e-4 * (times - 0.5) ** 2
    expected = np.where(times < 0.5, first_half, second_half)
    assert motion.displacement == pytest.approx(expected, abs=1e-19)


def test_a_falling_load_releases_a_lining_from_a_shaft_at_rest() -> None:
    """Without damping ``x = x_0 - r t + (r/omega) sin(omega t)``, of the limit's rate r."""
    bearing = replace(REFERENCE_BEARING, friction=Coulomb(0.3, 0.3), damping=0.0)
    time = np.linspace(0.0, 1.0, 2001)
    start = 0.3 * 1000.0 / bearing.stiffness
    drive = Drive.sampled(np.array([0.0, 1.0]), np.zeros(2), np.array([1000.0, 900.0]))
    motion = integrate(bearing, drive, MotionState(start, 0.0), time)
    assert motion.outcome is MotionOutcome.COMPLETE
    rate, omega = 0.1 * start, bearing.natural_frequency
    expected = start - rate * time + rate / omega * np.sin(omega * time)
    assert motion.displacement == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'time': [0.0, 1.0, 1.0, 2.0]}, r'drive time\[2\] = 1 s does not exceed time\[1\] = 1 s'),
        ({'load': [1.0, -2.0, 1.0, 1.0]}, r'drive load\[1\] = -2 N must not be negative'),
        ({'speed': [0.1, np.nan, 0.1, 0.1]}, r'drive speed\[1\] = nan must be a finite number'),
        ({'speed': [0.1]}, r'shape \(4,\), speeds of \(1,\)'),
        ({'time': [0.0], 'speed': [0.1], 'load': [1.0]}, 'drive has 1 samples: give at least two'),
    ],
)
def test_bad_drives_are_named(changes: dict[str, list[float]], message: str) -> None:
    grid = {'time': [0.0, 1.0, 3.0, 4.5], 'speed': [0.1] * 4, 'load': [1e3] * 4}
    with pytest.raises(PhysicsError, match=message):
        Drive.sampled(**(grid | changes))


# Order, drift, and the same numbers however a motion is cut or computed.
INSTANTS = np.linspace(0.0, 1.0, 51)
VARYING = Drive.sampled(INSTANTS, 0.09 * np.cos(5.0 * INSTANTS), 800.0 + 500.0 * np.sin(9.0 * INSTANTS))
LAWS = [
    Stribeck(0.3, 0.1, 10.0, 0.02),
    Coulomb(0.3, 0.12),
    Tabulated([0.005, 0.03, 0.1, 0.2], [0.3, 0.22, 0.12, 0.1]),
]


def motion_columns(motion: Motion) -> list[np.ndarray]:
    return [
        motion.displacement,
        motion.velocity,
        motion.acceleration,
        motion.relative_speed,
        motion.transitions.time,
    ]


@pytest.mark.parametrize('law', LAWS)
def test_numba_and_python_agree(law: Stribeck) -> None:
    pytest.importorskip('numba')
    bearing, times = replace(REFERENCE_BEARING, friction=law), np.linspace(0.0, 1.0, 501)
    motions = [
        integrate(bearing, VARYING, MotionState(1e-4, 0.02), times, compiled=compiled)
        for compiled in (True, False)
    ]
    compiled, plain = motions
    for a, b in zip(motion_columns(compiled), motion_columns(plain), strict=True):
        assert a == pytest.approx(b, rel=1e-12, abs=1e-12 * np.max(np.abs(b)))
    assert (compiled.steps, compiled.slip_steps) == (plain.steps, plain.slip_steps)
    assert np.array_equal(compiled.phase, plain.phase)


SIGNALLED = """
import signal
from shared import REFERENCE_BEARING
from stickslip_monitor.physics.integrator import Drive, MotionState, integrate

def interrupt(*_):
    raise KeyboardInterrupt

drive = Drive.constant(0.1, 1000.0, 1000.0)
integrate(REFERENCE_BEARING, Drive.constant(0.1, 1000.0, 0.1), MotionState(0.0, 0.0), compiled=True)
signal.signal(signal.SIGALRM, interrupt)
for _ in range(10):
    signal.setitimer(signal.ITIMER_REAL, 0.005)
    try:
        integrate(REFERENCE_BEARING, drive, MotionState(0.0, 0.0), compiled=True)
    except KeyboardInterrupt:
        print('interrupted')
"""


def test_a_signal_in_compiled_code_ends_the_motion_and_not_the_process() -> None:
    """Interrupt a thousand seconds at once: nearly all of the time goes by in the compiled loop."""
    pytest.importorskip('numba')
    completed = subprocess.run(
        [sys.executable, '-c', SIGNALLED], cwd=ROOT / 'test', capture_output=True, text=True, check=False
    )
    assert (completed.returncode, completed.stdout.split(), completed.stderr) == (0, ['interrupted'] * 10, '')


def test_without_numba_python_serves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jit, 'has_compiler', lambda: False)
    drive = Drive.constant(0.1, 1000.0, 0.05)
    assert integrate(REFERENCE_BEARING, drive, MotionState(0.0, 0.0)).steps > 0
    with pytest.raises(PhysicsError, match='needs numba, which is not installed'):
        integrate(REFERENCE_BEARING, drive, MotionState(0.0, 0.0), compiled=True)


@pytest.mark.parametrize('law', LAWS)
def test_cutting_a_drive_at_its_samples_changes_no_bit(law: Stribeck) -> None:
    bearing, times = replace(REFERENCE_BEARING, friction=law), np.linspace(0.0, 1.0, 257)
    uncut = integrate(bearing, VARYING, MotionState(0.0, 0.0), times, compiled=False)
    parts, state, cuts = [], MotionState(0.0, 0.0), (1, 2, 3, 20, 37)
    for first, last in zip((0, *cuts), (*cuts, 50), strict=True):
        rows = slice(first, last + 1)
        drive = Drive(INSTANTS[rows], VARYING.speed[rows], VARYING.load[rows])
        part_times = times[(times > drive.start) & (times <= drive.end)]
        part_times = part_times if first else np.append(0.0, part_times)
        parts.append(integrate(bearing, drive, state, part_times, compiled=False))
        state = parts[-1].final
    for i, column in enumerate(motion_columns(uncut)):
        assert np.array_equal(column, np.concatenate([motion_columns(part)[i] for part in parts]))
    assert state == uncut.final


@pytest.mark.slow
def test_many_cycles_do_not_drift() -> None:
    """Follow a hundred thousand cycles where numba is installed, two thousand elsewhere.

    The period is that of the exact cycle, found by another method.
    """
    speed, cycles = REFERENCE_BEARING.speed.to_surface(20.0, 'rpm'), 100_000 if HAS_NUMBA else 2_000
    exact = exact_cycle(REFERENCE_BEARING, speed, 1000.0)
    duration = (cycles + 10) * exact.period
    last_times = np.linspace(duration - 0.05, duration, 2001)
    motion = integrate(
        REFERENCE_BEARING,
        Drive.constant(speed, 1000.0, duration),
        MotionState(0.0, 0.0),
        np.append(np.linspace(0.3, 0.35, 2001), last_times),
    )
    t = motion.transitions
    releases = t.time[t.before == Phase.STICK][2:]
    assert releases.size > cycles
    assert (releases[-1] - releases[0]) / (releases.size - 1) == pytest.approx(exact.period, rel=1e-12)
    for x in (motion.displacement[:2001], motion.displacement[2001:]):
        assert 0.5 * np.ptp(x) == pytest.approx(exact.amplitude, rel=1e-5)


def slip_flow(bearing: Bearing, side: int, since: float, speed: np.poly1d, load: np.poly1d):
    """``(x', x'')`` of a slip on a side of the belt, with speed and load by the time since an instant."""
    top = float(bearing.friction.coefficient(1e-300))

    def flow(t: float, y: np.ndarray) -> list[float]:
        relative = side * (speed(t - since) - y[1])
        mu = float(bearing.friction.coefficient(relative)) if relative > 0.0 else top
        force = load(t - since) * side * mu - bearing.damping * y[1] - bearing.stiffness * y[0]
        return [y[1], force / bearing.mass]

    return flow


def follow_independently(bearing: Bearing, drive: Drive, motion: Motion, x: float, v: float) -> np.ndarray:
    """Displacement and velocity by scipy's DOP853 at the ends of all pieces of a motion, shape (n, 3).

    It changes its phase when the motion does, and has no other number of it. The third column is what
    must vanish where a phase ends: the relative speed at a contact, the share of the limit that is
    missing at a release; else 0.
    """
    changes = motion.transitions
    # Where a step of 2e-4 s passes the points of a table it errs by up to 2e-10.
    longest = 5e-5 if isinstance(bearing.friction, Tabulated) else 2e-4
    phase, time, rows = motion.start.phase, drive.start, []
    for end in np.union1d(changes.time, drive.time[1:]).tolist():
        piece = int(np.searchsorted(drive.time, end)) - 1
        since, length = drive.time[piece], drive.time[piece + 1] - drive.time[piece]
        speed, load = (np.poly1d([np.diff(y)[piece] / length, y[piece]]) for y in (drive.speed, drive.load))
        if phase == Phase.STICK:
            x, v = x + 0.5 * (speed(time - since) + speed(end - since)) * (end - time), speed(end - since)
        else:
            flow = slip_flow(bearing, phase, since, speed, load)
            path = solve_ivp(flow, (time, end), (x, v), 'DOP853', rtol=1e-13, atol=1e-18, max_step=longest)
            x, v = path.y[:, -1].tolist()
        miss = 0.0
        for after in changes.after[changes.time == end]:
            if phase == Phase.STICK:
                need = bearing.mass * speed[1] + bearing.damping * v + bearing.stiffness * x
                miss = 1.0 - after * need / (bearing.friction.static * load(end - since))
            else:
                miss = speed(end - since) - v
            phase = after
        rows.append((x, v, miss))
        time = end
    return np.array(rows)


@pytest.mark.parametrize('law', [*LAWS, Stretched(0.3, 0.1, 10.0), Stretched(0.3, 0.1, 10.0, 0.0, 1.5)])
def test_motion_is_that_of_an_independent_integrator(law: Stribeck) -> None:
    """Sticks, slips, overtakes and a belt that reverses, with load and speed that change in each piece."""
    bearing = replace(REFERENCE_BEARING, friction=law)
    drive = Drive.sampled([0.0, 0.11, 0.2, 0.33], [0.06, 0.01, -0.05, -0.03], [1500.0, 900.0, 400.0, 2100.0])
    first = integrate(bearing, drive, MotionState(4e-4, 0.01), compiled=False)
    assert {(Phase.FORWARD, Phase.STICK), (Phase.STICK, Phase.BACKWARD)} <= set(
        zip(first.transitions.before.tolist(), first.transitions.after.tolist(), strict=True)
    )
    times = np.union1d(first.transitions.time, drive.time[1:])
    motion = integrate(bearing, drive, MotionState(4e-4, 0.01), times, compiled=False)
    x, v, miss = follow_independently(bearing, drive, motion, 4e-4, 0.05).T
    # The steps of the other method pass the points of a table as they come.
    close = 1e-10 if isinstance(law, Tabulated) else 1e-12
    assert motion.displacement == pytest.approx(x, abs=close * np.ptp(x))
    assert motion.velocity == pytest.approx(v, abs=close * np.ptp(v))
    assert np.max(np.abs(miss)) < close


def random_case(seed: int) -> tuple[Bearing, Drive]:
    """Return any law, damping and load, with inputs that stop and vanish."""
    rng = np.random.default_rng(seed)
    low, high = rng.uniform(0.05, 0.5, 2)
    points = np.sort(rng.uniform(0.0, 0.2, 5))
    law = [
        Stribeck(low, high, 10.0 ** rng.uniform(-1.0, 4.0)),
        Coulomb(low, high),
        Tabulated(points.tolist(), rng.uniform(0.0, 0.5, 5).tolist()),
    ][seed % 3]
    time = np.cumsum(rng.uniform(0.2, 1.0, 12)) * 10.0 ** rng.uniform(-3.0, -1.3)
    speed = np.where(rng.random(12) < 0.2, 0.0, 0.1 * rng.standard_normal(12))
    load = np.where(rng.random(12) < 0.2, 0.0, 10.0 ** rng.uniform(1.0, 4.5) * rng.random(12))
    damping = float(rng.choice([0.0, 400.0, 2.0e4]))
    bearing = replace(REFERENCE_BEARING, friction=law, damping=damping)
    return bearing, Drive.sampled(time, speed, load)


@pytest.mark.parametrize('seed', range(9))
def test_random_motions_keep_the_law(seed: int) -> None:
    """Miss no contact; sticking never exceeds its limit, and slip has its friction.

    Displacement, velocity and acceleration belong together by Simpson's rule between transitions
    and samples of the drive.
    """
    bearing, drive = random_case(seed)
    times = np.linspace(drive.start, drive.end, 4001)
    motion = integrate(bearing, drive, MotionState(1e-4, 0.0), times, compiled=False)
    assert motion.outcome is MotionOutcome.COMPLETE
    x, v, a = motion.displacement, motion.velocity, motion.acceleration
    breaks = np.searchsorted(times, np.concatenate([motion.transitions.time, drive.time]))
    smooth = np.ones(times.size - 2, bool)
    smooth[np.clip(breaks[:, None] + np.arange(-3, 2), 0, smooth.size - 1)] = False
    third = (times[1] - times[0]) / 3.0
    for integral, rate, tolerance in ((x, v, 1e-7), (v, a, 2e-5)):
        step = integral[2:] - integral[:-2] - third * (rate[:-2] + 4.0 * rate[1:-1] + rate[2:])
        assert np.max(np.abs(step[smooth])) < tolerance * np.ptp(integral)
    fastest = np.max(np.abs(motion.relative_speed)) + 0.1
    assert np.all(motion.relative_speed * motion.phase >= -1e-13 * fastest)
    load = np.interp(times, drive.time, drive.load)
    inner = bearing.mass * a + bearing.damping * v
    spring = bearing.stiffness * x
    scale = 1.0 + np.max(load) + np.max(np.abs(spring)) + np.max(np.abs(inner))
    slow = np.maximum(np.abs(motion.relative_speed), 1e-300)
    sliding = load * np.asarray(bearing.friction.coefficient(slow)) * motion.phase
    limit = max(bearing.friction.static, float(bearing.friction.coefficient(1e-300)))
    sticks = motion.sticking
    assert np.all(np.abs((inner + spring)[sticks]) <= limit * load[sticks] + 1e-12 * scale)
    assert np.max(np.abs((inner + spring - sliding)[~sticks]), initial=0.0) < 1e-8 * scale
