# SPDX-License-Identifier: Apache-2.0
"""Asks about a configuration that looks like another unit, or a slip: nothing is refused here.

``assess`` asks at its load, ``check`` at the largest load that it met. A question is a clause that follows
the name of an input: "speed on /shaft/speed turns a journal of 400 m: ...?".
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import numpy as np

from stickslip_monitor.monitor.parameters import BearingConfig, InputConfig, LoadConfig
from stickslip_monitor.physics.averaging import fold_speed, hopf_speed
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.cycles import end_of_vibration
from stickslip_monitor.physics.friction import Tabulated
from stickslip_monitor.physics.lubrication import as_measured, reference_point
from stickslip_monitor.physics.scalar_law import law_bounds

THICKEST = 1.0
"""Journal diameter from which on it may be in another unit [m]."""
REST_SHARE = 0.1
"""Share of the fold speed that a shaft at rest may reach; the default is below a fiftieth."""
LARGEST_MOTION = 0.1
"""Share of the journal's diameter that no lining moves."""
LOWEST_TONE, HIGHEST_TONE = 1.0, 20_000.0
"""Natural frequencies of linings: chatter from some hertz on, squeal up to some kilohertz [Hz]."""
FACTOR = 5.0
"""Times the load: a bearing whose friction law is at fault has no boundary there either."""
ENDS_EARLY = 0.2
"""Share of a curve's steepest fall above which it ends in the midst of it."""
BLADES = range(3, 8)
"""Numbers of blades of ships' propellers."""
NEAR_BOUNDARIES = 0.5, 1.5
"""Of the Hopf and the fold speed: between them a load that swings with the lining moves the onset."""
_AVERAGED = re.compile(r'(?<![a-z])(?:avg|average|averaged|mean)(?![a-z])', re.IGNORECASE)
BREAKAWAY = 0.5
"""A breakaway coefficient below this share of the next value is no measured one."""


def questions(config: BearingConfig, load: float) -> dict[str, list[str]]:
    """Return the questions about a bearing at a load [N]: clauses under ``speed`` and under ``load``.

    A list is empty where there is none. At a load of 0 or below only what needs no load is asked.
    """
    return {
        'speed': [*_average_questions(config.speed), *_speed_questions(config, load)],
        'load': [*_average_questions(config.load), *_load_questions(config, load)],
    }


def question_sentences(config: BearingConfig, load: float | None = None) -> list[str]:
    """Return the :func:`questions` as sentences, an empty list for none.

    Without a load they are those at the largest assumed load, or without any if the load is measured.
    """
    if load is None:
        load = 0.0 if config.load.assumed is None else config.load.assumed[1]
    answers = questions(config, load)
    return [f'{config.name}: {name} {clause}' for name, clauses in answers.items() for clause in clauses]


def _average_questions(source: InputConfig) -> Iterator[str]:
    """Yield a clause where the name of a source says that it is an average; an assumed load has none."""
    if isinstance(source, LoadConfig) and source.assumed is not None:
        return
    named = _AVERAGED.search(f'{source.topic} {source.field_text} {source.column}')
    if named:
        yield (
            f"is called '{named[0]}': an average hides swell and short stick-slip; is there the measurement"
            ' itself?'
        )


def _speed_questions(config: BearingConfig, load: float) -> Iterator[str]:
    """Yield clauses on diameter, speed of rest and friction that look wrong at a load [N]."""
    diameter, rest = config.bearing.journal_diameter, config.alarm.minimum_speed
    if diameter >= THICKEST:
        yield f'turns a journal of {diameter:g} m: is journal_diameter in metres?'
    fold = fold_of(config, load)
    if rest > REST_SHARE * fold:
        rpm = float(config.bearing.speed.from_surface(rest, 'rpm'))
        yield (
            f'counts as rest up to {rest:g} m/s ({rpm:.3g} rpm), {rest / fold:.2g} times the fold'
            ' speed: is alarm.minimum_speed in m/s?'
        )
    texts = list(_friction_questions(config, load))
    if not texts and load > 0.0 and diameter < THICKEST and fold_of(config, FACTOR * load) == math.inf:
        texts.append(
            f'has no boundary at any load up to {FACTOR:g} times the largest seen, {load:.4g} N: are the'
            ' friction law, units, scales and topics of speed and load right?'
        )
    yield from texts


def _load_questions(config: BearingConfig, load: float) -> Iterator[str]:
    """Yield clauses on mass, stiffness, damping, blades and amplitude limit that look wrong at a load [N]."""
    bearing = config.bearing
    tone = bearing.natural_frequency / math.tau
    if not LOWEST_TONE <= tone <= HIGHEST_TONE:
        yield (
            f'is on a lining of {bearing.mass:g} kg and {bearing.stiffness:g} N/m, which vibrates'
            f' at {tone:.3g} Hz: are mass and stiffness in kg and N/m?'
        )
    elif bearing.damping_ratio > 1.0:
        yield (
            f'is on a lining with {bearing.damping_ratio:.3g} times its critical damping: are mass,'
            ' damping and stiffness in kg, N s/m and N/m?'
        )
    # A cycle sticks as long as the surface is not outrun: its amplitude is about V/omega.
    amplitude = fold_of(config, load) / bearing.natural_frequency
    if text := blade_question(bearing, load):
        yield text
    limit = LARGEST_MOTION * bearing.journal_diameter
    if limit < amplitude < math.inf:
        yield (
            f'would move the lining by {amplitude:.3g} m in a journal of'
            f' {bearing.journal_diameter:g} m: are mass and stiffness in kg and N/m?'
        )
    if limit < config.alarm.amplitude_limit < math.inf:
        yield (
            f'may move the lining by {config.alarm.amplitude_limit:g} m: is alarm.amplitude_limit in metres?'
        )


def blade_question(bearing: Bearing, load: float) -> str:
    """Return a clause where a propeller's blades meet a natural frequency near the boundaries; else ''.

    At a load of 0 or below [N] it is ''. Far from the boundaries the mean load counts; near them a swing of
    5 % moves the onset by a fifth (docs/physics.md).
    """
    if not load > 0.0:
        return ''
    rpm = float(bearing.speed.factor('rpm'))
    low = NEAR_BOUNDARIES[0] * float(hopf_speed(bearing, load)) / rpm
    high = NEAR_BOUNDARIES[1] * float(fold_speed(bearing, load)) / rpm
    tone = bearing.natural_frequency / math.tau
    meets = [(count, 60.0 * tone / count) for count in BLADES if low <= 60.0 * tone / count <= high]
    if not meets:
        return ''
    listed = ', '.join(f'{speed:.3g} rpm of {count}' for count, speed in meets)
    return (
        f"may swing at the lining's natural frequency, {tone:.3g} Hz, with the blades of a propeller"
        f' ({listed}), near the boundaries: a swing of 5 % moves the onset by a fifth there; how many blades'
        ' are there?'
    )


def _friction_questions(config: BearingConfig, load: float) -> Iterator[str]:
    """Yield clauses on a friction law that looks wrong at a load [N]."""
    law = config.bearing.friction
    if isinstance(law, Tabulated) and law.values[0] < BREAKAWAY * law.values[1]:
        yield (
            f'has a law that begins with {law.values[0]:g}, far below its next value'
            f' {law.values[1]:g}: is the first of friction.coefficient a measured breakaway?'
        )
    yield from table_end_questions(config.bearing, load)
    at_rest = float(np.asarray(law.coefficient(np.zeros(1)))[0])
    sliding = float(np.min(np.asarray(law.coefficient(np.linspace(1e-3, 2.0, 200)))))
    if load > 0.0 and at_rest <= sliding and fold_of(config, FACTOR * load) == math.inf:
        yield (
            f'can never bring stick-slip: friction at rest, {at_rest:.4g}, is not above the least'
            f' of sliding friction, {sliding:.4g}: are static and kinetic swapped?'
        )


def table_end_questions(bearing: Bearing, load: float) -> Iterator[str]:
    """Yield at most one clause: a verdict at a load [N] rests on speeds at which friction was not measured.

    Nothing is yielded of a law that is no table, nor at a load of 0 or below.
    """
    law = bearing.friction
    if not isinstance(law, Tabulated) or not load > 0.0:
        return
    _, load, _ = reference_point(bearing, 0.0, load)
    bearing = as_measured(bearing)
    last, enough, fall = law.speed[-1], bearing.damping / load, _last_fall(law)
    rpm = float(bearing.speed.from_surface(last, 'rpm'))
    if fall > enough:
        yield (
            f'has a law that still falls at its highest measured speed, {last:g} m/s'
            f' ({rpm:.3g} rpm), by {fall:.3g} s/m, and {enough:.3g} s/m are enough for stick-slip'
            ' at this load: can friction be measured at higher speeds?'
        )
        return
    # The relative speed in a cycle reaches twice the shaft's, and the end has to be still falling.
    reach = 2.0 * float(fold_speed(bearing, load))
    if last < reach < math.inf and fall > 0.0:
        yield (
            f'has a law whose highest measured speed is {last:g} m/s ({rpm:.3g} rpm), and cycles'
            f' at the fold slide at up to {reach:.3g} m/s: can friction be measured there?'
        )


def note_on_table(bearing: Bearing) -> str:
    """Return a clause on a measured curve that ends in its fall; '' for any other law or without damping."""
    law = bearing.friction
    if not isinstance(law, Tabulated) or bearing.damping == 0.0:
        return ''
    fall = _last_fall(law)
    if not fall > ENDS_EARLY * law_bounds(law).fall:
        return ''
    return (
        f'friction still falls by {fall:.3g} s/m at its highest measured speed, {law.speed[-1]:g} m/s: above'
        f' {bearing.damping / fall / 1e3:.3g} kN verdicts at higher speeds rest on nothing measured'
    )


def _last_fall(law: Tabulated) -> float:
    """Return how steeply a measured curve falls at its end [s/m]: the larger of chord and own slope there."""
    chord = (law.values[-2] - law.values[-1]) / (law.speed[-1] - law.speed[-2])
    return max(chord, -float(np.asarray(law.slope(np.array([law.speed[-1]])))[0]))


def fold_of(config: BearingConfig, load: float) -> float:
    """Return the fold speed that decides at a load [m/s]; ``inf`` without a fold or a load above 0."""
    fold = float(end_of_vibration(config.bearing, load)) if load > 0.0 else math.nan
    return fold if math.isfinite(fold) else math.inf
