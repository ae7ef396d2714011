# SPDX-License-Identifier: Apache-2.0
"""Gaps of a topic; expected values by hand."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_logs import START
from sending import configured
from shared import CONFIG, ROOT

from stickslip_logs.recordings.writer import BagWriter, encode_float64s, encode_stamped
from stickslip_monitor.arrays import IntArray
from stickslip_monitor.cli import main
from stickslip_monitor.monitor.assessment import assess
from stickslip_monitor.monitor.input_faults import InputFacts, Publisher, input_fault
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.monitor.parameters import BearingConfig
from stickslip_monitor.monitor.sample_types import Status
from stickslip_monitor.offline.check import check_recording, to_json
from stickslip_monitor.offline.input_report import FillerSearch, Gap, Gaps, Plausibility, StandingValue
from stickslip_monitor.physics.friction import Coulomb, Stribeck

NS = 10**9


def find_gaps(stamp_ns: IntArray, limit_ns: int) -> Gaps:
    """Find the gaps of stamps that come in two parts."""
    gaps, cut = Gaps(limit_ns), len(stamp_ns) // 2
    for part in (stamp_ns[:cut], stamp_ns[cut:]):
        gaps.take(part, part)
    return gaps


def test_rate_and_gaps() -> None:
    seconds = [0, 1, 2, 3, 13, 14, 15, 115]
    gaps = find_gaps(np.array(seconds, np.int64) * NS, 5 * NS)
    assert gaps.count == 2
    assert gaps.longest == [Gap(15 * NS, 100.0), Gap(3 * NS, 10.0)]
    # Five intervals of a second, apart from the gaps.
    assert gaps.rate == pytest.approx(1.0)


@pytest.mark.parametrize('copies', [1, 2, 3])
def test_values_in_pairs_have_the_rate_of_their_times(copies: int) -> None:
    # Minimum and maximum of ten seconds, 1 ms apart: a fifth of a value a second, not a thousand.
    stamps = np.add.outer(np.arange(200) * 10 * NS, np.arange(copies) * NS // 1000).ravel()
    rate = find_gaps(stamps.astype(np.int64), 5 * NS).rate
    assert rate == pytest.approx(copies / 10, rel=0.02)


def test_an_interval_of_just_the_limit_is_no_gap() -> None:
    assert find_gaps(np.array([0, 5, 10], np.int64) * NS, 5 * NS).count == 0


def test_only_the_longest_are_named() -> None:
    stamps = np.cumsum(np.arange(6, 30)) * NS
    gaps = find_gaps(stamps.astype(np.int64), 5 * NS)
    assert gaps.count == 23
    assert [gap.seconds for gap in gaps.longest] == [29.0, 28.0, 27.0, 26.0, 25.0]


def test_a_jump_back_is_no_gap_and_no_time() -> None:
    gaps = find_gaps(np.array([100, 101, 102, 0, 1, 2], np.int64) * NS, 5 * NS)
    assert gaps.count == 0
    assert gaps.rate == pytest.approx(5 / 4)


@pytest.mark.parametrize('count', [0, 1])
def test_too_few_messages_have_no_rate(count: int) -> None:
    gaps = find_gaps(np.zeros(count, np.int64), NS)
    assert math.isnan(gaps.rate)
    assert gaps.count == 0


BEARING = load_config(CONFIG).bearings[0]
FOLD = 0.2132


def plausibility_questions(
    speed: list[float], load: list[float], config: BearingConfig = BEARING
) -> dict[str, list[str]]:
    plausibility = Plausibility(config)
    points = assess(config.bearing, np.array(speed), np.array(load))
    # In two parts: what is said of a recording does not depend on how it is cut.
    for part in (slice(1), slice(1, None)):
        plausibility.take(
            points.speed[part], points.load[part], lambda rows, part=part: points.fold_speed[part][rows]
        )
    ratio = np.abs(points.speed) / points.fold_speed
    return plausibility.questions(float(ratio[ratio > 0.0].min(initial=np.inf)))


@pytest.mark.parametrize(
    ('speed', 'load'),
    [
        ([0.1, 0.3, 1.0], [1000.0] * 3),
        # A shaft at rest says nothing, and a yacht's shaft turns far above the fold at sea.
        ([0.0, 19.0 * FOLD], [1000.0] * 2),
        ([0.0, 0.0], [1000.0] * 2),
        ([FOLD / 4.9, FOLD / 50.0], [1000.0] * 2),
        # A load of 5 times 41 N has a boundary.
        ([0.3], [41.0]),
        ([0.3, 0.3], [-5.0, 1000.0]),
        ([], []),
    ],
)
def test_plausible_operating_points_raise_no_question(speed: list[float], load: list[float]) -> None:
    assert plausibility_questions(speed, load) == {'speed': [], 'load': []}


@pytest.mark.parametrize(
    ('speed', 'load', 'quantity', 'words'),
    [
        ([0.1, -31.0], [1000.0] * 2, 'speed', 'reaches 31 m/s at the surface'),
        ([21.0 * FOLD, 5.0], [1000.0] * 2, 'speed', 'is never below 21 times the fold speed'),
        ([FOLD / 10.0], [1000.0], 'speed', 'is never above 0.1 times the fold speed'),
        ([0.3], [39.0], 'speed', 'has no boundary at any load up to 5 times the largest seen, 39'),
        ([0.1] * 3, [-900.0, -800.0, 100.0], 'load', 'is negative for most of the time'),
    ],
)
def test_implausible_operating_points_raise_a_question(
    speed: list[float], load: list[float], quantity: str, words: str
) -> None:
    questions = plausibility_questions(speed, load)
    (question,) = questions.pop(quantity)
    assert question.startswith(words)
    assert question.endswith('?')
    assert not any(questions.values())


def test_a_shaft_a_hundred_metres_thick() -> None:
    thick = replace(BEARING, bearing=replace(BEARING.bearing, journal_diameter=100.0))
    assert plausibility_questions([0.2], [1000.0], thick)['speed'] == [
        'turns a journal of 100 m: is journal_diameter in metres?'
    ]


def test_friction_that_rises_from_rest_raises_a_question() -> None:
    swapped = replace(BEARING, bearing=replace(BEARING.bearing, friction=Stribeck(0.1, 0.3, 10.0)))
    (question,) = plausibility_questions([0.2], [1000.0], swapped)['speed']
    assert question.endswith('are static and kinetic swapped?')


def test_a_load_of_exactly_nothing_under_a_turning_shaft() -> None:
    for other_count in (1, 18):
        (question,) = plausibility_questions([0.2] * (2 + other_count), [0.0, 0.0] + [1000.0] * other_count)[
            'load'
        ]
        assert question.startswith(
            f'is exactly 0 in {2 / (2 + other_count):.0%} of the values while the shaft turns'
        )
    assert plausibility_questions([0.2] * 50, [0.0, 0.0] + [1000.0] * 48)['load'] == []
    assert plausibility_questions([0.0, 0.0, 0.3], [0.0, 0.0, 1000.0])['load'] == []


@pytest.mark.parametrize(
    ('load', 'sentence'),
    [
        ([1000.0] * 50 + [1.0] * 50, 'is below 1.78 N in 50% of the values and above 1e+03 N in the others'),
        ([1000.0] * 97 + [1.0] * 3, ''),
        ([1000.0] * 50 + [30.0] * 50, ''),
        (np.geomspace(1.0, 1000.0, 100).tolist(), ''),
    ],
    ids=['kN for N half way', 'some values', 'a light ship', 'all between'],
)
def test_a_load_whose_unit_was_changed_on_the_way(load: list[float], sentence: str) -> None:
    (question,) = plausibility_questions([0.3] * len(load), load)['load'] or ['']
    assert question.startswith(sentence)
    assert bool(question) == bool(sentence)


def test_coulomb_friction_has_a_fold_of_the_exact_model_alone() -> None:
    """1 kN on 2 MN/m: a cycle sticks up to 7.19 rpm (0.0377 m/s), by time integration 7.2 rpm."""
    coulomb = replace(BEARING, bearing=replace(BEARING.bearing, friction=Coulomb(0.3, 0.1)))
    assert plausibility_questions([0.03, 0.1], [1000.0] * 2, coulomb) == {'speed': [], 'load': []}
    assert plausibility_questions([0.9], [1000.0], coulomb)['speed'][0].startswith(
        'is never below 23.9 times the fold speed'
    )


FLOAT, STAMPED = 'std_msgs/msg/Float64', 'geometry_msgs/msg/WrenchStamped'
SPEED, LOAD = '/shaft/speed', '/bearing/aft_stern/load'


def load_fault(**settings: Any) -> str:
    """Return the running monitor's sentence on the load."""
    return input_fault(InputFacts(LOAD, FLOAT, True, **settings))


CASES = {
    'missing': (None, None, load_fault()[:-1] + f": the recording has no topic '{LOAD}': it has {SPEED}"),
    'silent': (FLOAT, (), load_fault()),
    'type': (
        'std_msgs/msg/Bool',
        (),
        load_fault(publishers=[Publisher("Bag 'bag.mcap'", 'std_msgs/msg/Bool')])[:-1],
    ),
    'refused': (
        FLOAT,
        np.full(100, np.nan),
        load_fault(publishers=[Publisher('x', FLOAT)], refused=Status.NOT_FINITE),
    ),
}


@pytest.mark.parametrize(('kind', 'values', 'sentence'), CASES.values(), ids=CASES)
def test_why_an_input_brings_nothing(
    kind: str | None,
    values: np.ndarray | None,
    sentence: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    time = START + np.arange(100) * 10**8
    with BagWriter(tmp_path / 'bag.mcap') as bag:
        bag.add_topic(SPEED, FLOAT)
        bag.write_float64s({SPEED: (time, np.full(100, 30.0))})
        if kind is not None and values is not None:
            bag.add_topic(LOAD, kind)
            if len(values):
                bag.write_columns([(LOAD, time, encode_float64s(values))])
    assert main(['check', str(tmp_path / 'bag.mcap'), '--config', str(CONFIG)]) == 2
    printed = ''.join(capsys.readouterr())
    assert sentence in printed


def test_a_topic_that_is_missing_in_a_cut_recording_is_reported_with_the_cut(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, time = tmp_path / 'cut.mcap', START + np.arange(1000) * 10**8
    with BagWriter(path) as bag:
        bag.add_topic(SPEED, FLOAT)
        bag.write_columns([(SPEED, time, encode_float64s(np.full(1000, 30.0)))])
    path.write_bytes(path.read_bytes()[:-50])
    assert main(['check', str(path), '--config', str(CONFIG)]) == 2
    assert re.search(r"No publisher on .*; file 'cut.mcap' is truncated in ", capsys.readouterr().err)


def test_of_a_recording_cut_before_its_first_message_no_publisher_is_missed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / 'cut.mcap'
    path.write_bytes(next((ROOT / 'bags' / 'coast_down').glob('*.mcap')).read_bytes()[:40_000])
    assert main(['check', str(path), '--config', str(CONFIG)]) == 2
    assert f"nothing of '{path}' can be read: file 'cut.mcap' is truncated in " in capsys.readouterr().err


def test_clocks_that_differ_lose_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Stamps of the load are 100 s behind when they are recorded: then the arrival counts."""
    time = START + np.arange(100) * 10**8
    with BagWriter(tmp_path / 'bag.mcap') as bag:
        bag.add_topic(SPEED, FLOAT)
        bag.add_topic(LOAD, STAMPED)
        stamped = encode_stamped(STAMPED, 'wrench.force.z', time - 100 * 10**9, np.full(100, 1e3))
        bag.write_columns([(SPEED, time, encode_float64s(np.full(100, 30.0))), (LOAD, time, stamped)])
    config = tmp_path / 'config.yaml'
    text = CONFIG.read_text('utf-8')
    old = text[text.index('load: {') :].splitlines()[0]
    new = f'load: {{topic: {LOAD}, type: {STAMPED}, field: wrench.force.z, unit: N}}'
    config.write_text(text.replace(old, new))
    assert main(['check', str(tmp_path / 'bag.mcap'), '--config', str(config), '--json']) == 1
    (bearing,) = json.loads(capsys.readouterr().out)['bearings'].values()
    assert [record['used'] for record in bearing['inputs'].values()] == [100, 100]
    assert [event['to'] for event in bearing['events']] == ['bistable']


def check_recorded(path: Path, interval: float, rpm: list[float], config: Path = CONFIG) -> dict[str, Any]:
    """Return the record of a check of a recording, MCAP or CSV, of some speeds under one load."""
    seconds = interval * np.arange(len(rpm))
    if path.suffix == '.csv':
        rows = (f'{at},{"Bad" if np.isnan(n) else n},1000\n' for at, n in zip(seconds, rpm, strict=True))
        path.write_text('time [s],shaft speed [rpm],load [N]\n' + ''.join(rows))
    else:
        time = START + (seconds * 1e9).astype(np.int64)
        with BagWriter(path) as bag:
            bag.add_topic(SPEED, FLOAT)
            bag.add_topic(LOAD, FLOAT)
            bag.write_float64s({SPEED: (time, rpm), LOAD: (time, np.full(len(rpm), 1000.0))})
    return to_json(check_recording(path, load_config(config)))


@pytest.mark.parametrize('name', ['a.mcap', 'a.csv'])
@pytest.mark.parametrize(('interval', 'is_reported'), [(9.9, False), (20.0, True)])
def test_samples_far_apart_are_reported(
    tmp_path: Path, name: str, interval: float, is_reported: bool
) -> None:
    warnings = ' '.join(check_recorded(tmp_path / name, interval, [60.0] * 30)['warnings'])
    text = f'samples are {interval:g} s apart: stick-slip shorter than some minutes cannot be seen'
    assert (text in warnings) == is_reported


@pytest.mark.parametrize(
    ('interval', 'rpm', 'is_asked'), [(60, 20.0, True), (60, 0.0, False), (5, 20.0, False)]
)
def test_single_slow_values_where_stick_slip_starts_raise_a_question(
    tmp_path: Path, interval: int, rpm: float, is_asked: bool
) -> None:
    speeds = [136.0] * 9 + [rpm] + [136.0] * 9
    (bearing,) = check_recorded(tmp_path / 'a.csv', interval, speeds)['bearings'].values()
    assert bearing['events'] == []
    text = 'is where stick-slip starts by itself for 60 s, by single values 60 s apart'
    assert any(text in question for question in bearing['inputs']['speed']['questions']) == is_asked


@pytest.mark.parametrize('name', ['a.mcap', 'a.csv'])
def test_a_speed_that_is_held_raises_a_question(tmp_path: Path, name: str) -> None:
    rpm = np.repeat(60.0 + 5.0 * np.sin(1.3 * np.arange(30) ** 1.1), 20).tolist()
    (bearing,) = check_recorded(tmp_path / name, 0.5, rpm)['bearings'].values()
    (question,) = bearing['inputs']['speed']['questions']
    assert question.startswith('has a new value only every 10 s, though 2 messages a second come')
    assert bearing['inputs']['load']['questions'] == []


@pytest.mark.parametrize(('interval', 'is_named'), [(60, True), (1, False)])
def test_a_slow_level_raises_a_question(tmp_path: Path, interval: int, is_named: bool) -> None:
    rows = (f'{at},60,1000,{0.01 + 1e-6 * at if at % interval == 0 else ""}\n' for at in range(900))
    (tmp_path / 'a.csv').write_text('time [s],shaft speed [rpm],load [N],level [m/s²]\n' + ''.join(rows))
    record = to_json(check_recording(tmp_path / 'a.csv', configured(level__topic='/level')))
    questions = record['bearings']['aft']['inputs']['level']['questions']
    assert [text for text in questions if text.startswith('has a value only every 60 s, and a vib')] == (
        questions[:1] if is_named else []
    )
    assert bool(questions) == is_named


@pytest.mark.parametrize('name', ['a.mcap', 'a.csv'])
def test_messages_without_a_value_are_counted(tmp_path: Path, name: str) -> None:
    rpm = [60.0, np.nan, 60.0, -999.25, 60.0, np.nan] * 5
    (bearing,) = check_recorded(tmp_path / name, 1.0, rpm)['bearings'].values()
    counts = [
        (record['messages'], record['used'], record['without_value']) for record in bearing['inputs'].values()
    ]
    assert counts == [(30, 15, 15), (30, 30, 0)]


def test_a_shaft_at_rest_is_not_the_worst_of_a_voyage(tmp_path: Path) -> None:
    record = check_recorded(tmp_path / 'a.mcap', 1.0, [60.0] * 20 + [0.0] * 20)
    worst = record['bearings']['aft_stern']['worst']
    expected = assess(BEARING.bearing, BEARING.bearing.speed.factor('rpm') * 60.0, 1000.0)
    assert worst['fold_margin']['value'] == pytest.approx(expected.fold_margin, rel=1e-7)
    assert worst['hopf_margin']['value'] == pytest.approx(expected.hopf_margin, rel=1e-12)


@pytest.mark.parametrize(('interval', 'complete'), [(0.0, False), (1e-9, False), (1e-6, False), (2e-4, True)])
def test_messages_without_time_between_them_are_no_quiet_voyage(
    interval: float, complete: bool, tmp_path: Path
) -> None:
    """Log times of 0, as of a recorder on simulated time without a /clock, or in s for ns."""
    record = check_recorded(tmp_path / 'a.mcap', interval, [20.0] * 200)
    assert record['complete'] == complete
    assert complete != any('hardly any time between them' in text for text in record['warnings'])


@pytest.mark.parametrize(
    ('seconds', 'sentence'),
    [
        (np.minimum(np.arange(700), 200), '500 messages on x in a row have one time'),
        (np.arange(60_000) // 200, ''),
        (np.arange(700), ''),
        (np.full(700, 5), '700 messages on x have hardly any time between them'),
        (np.full(3, 5), '3 messages on x have hardly any time between them'),
        (np.full(2, 5), ''),
    ],
    ids=[
        'a clock that stands from 200 s on',
        'whole seconds at 200 Hz',
        'seconds',
        'no clock',
        'three',
        'a pair',
    ],
)
def test_a_clock_that_stands_still(seconds: IntArray, sentence: str) -> None:
    for size in (7, 100_000):
        gaps, stamps = Gaps(NS), np.arange(seconds.size)
        for begin in range(0, seconds.size, size):
            part = slice(begin, begin + size)
            gaps.take(stamps[part], seconds[part] * NS)
        assert gaps.crowding_text('x').startswith(sentence)
        assert bool(gaps.crowding_text('x')) == bool(sentence)


def test_the_worst_margin_of_a_law_without_an_averaged_fold(tmp_path: Path) -> None:
    text, law = CONFIG.read_text(), '{law: coulomb, static: 0.30, kinetic: 0.10}'
    config = tmp_path / 'coulomb.yaml'
    config.write_text(re.sub(r'friction: \{.*\}', f'friction: {law}', text))
    record = check_recorded(tmp_path / 'a.mcap', 1.0, [60.0] * 20 + [5.0] * 20, config)
    (bearing,) = record['bearings'].values()
    expected = assess(load_config(config).bearings[0].bearing, 5.0 * math.pi * 0.1 / 60.0, 1000.0)
    # Read off the table of the exact fold, which is right to 1e-8 (the fold itself to 1e-9).
    assert bearing['worst']['fold_margin']['value'] == pytest.approx(expected.fold_margin, rel=1e-8)
    assert [text for input_record in bearing['inputs'].values() for text in input_record['questions']] == []


@pytest.mark.parametrize(
    ('unit', 'scale', 'expected'),
    [
        ('kN', 0.03, '30 to 30 kN (30000 to 30000 N; sent as 1000 to 1000)'),
        ('N', 12.3456, '12350 to 12350 N (sent as 1000 to 1000)'),
    ],
)
def test_a_large_load_has_no_exponent(unit: str, scale: float, expected: str, tmp_path: Path) -> None:
    """Print 30 kN and 12 345.6 N with four digits."""
    config = tmp_path / 'config.yaml'
    config.write_text(CONFIG.read_text('utf-8').replace('unit: N,', f'unit: {unit}, scale: {scale},'))
    report = check_recorded(tmp_path / 'bag.mcap', 1.0, [30.0] * 9, config)
    (bearing,) = report['bearings'].values()
    assert bearing['inputs']['load']['values'] == expected


@pytest.mark.parametrize(('has_peaks', 'filler'), [(False, 16.0), (True, None)])
def test_a_level_that_is_cut_at_a_limit_has_no_filler(has_peaks: bool, filler: float | None) -> None:
    # A level leaps from its background to the end of its range.
    search = FillerSearch(has_peaks=has_peaks)
    for begin in (0, 500):
        value = 0.2 + 0.01 * (np.arange(begin, begin + 500) * 7 % 13)
        value[100:150] = 16.0
        search.take(value)
    assert search.filler == filler


NOISE = np.random.default_rng(7).normal(0.0, 1.0, 3000)
COUNTS = np.arange(3000)


@pytest.mark.parametrize('cuts', [[], [1, 1500, 2000, 2003]])
@pytest.mark.parametrize(
    ('value', 'is_asked'),
    [
        (np.where(COUNTS < 2000, (80 + NOISE).round(2), 81.37), True),
        (np.where(COUNTS < 2950, (80 + NOISE).round(2), 81.37), False),  # too short
        (np.where(COUNTS < 2000, (80 + NOISE).round(2), 0.0), False),  # at rest
        (np.where(COUNTS < 2000, (80 + NOISE).round(0), 80.0), True),
        ((80 + 0.2 * NOISE).round(0), False),  # few digits
        (np.where(COUNTS < 2000, 0.04 * COUNTS, 80.0), False),  # no noise: commanded
        (np.where(COUNTS % 1500 < 1000, (80 + NOISE).round(2), 80.0), False),  # as it was before
        ((80 + NOISE).round(2), False),
    ],
)
def test_a_last_value_that_a_historian_repeats_raises_a_question(
    value: np.ndarray, is_asked: bool, cuts: list[int]
) -> None:
    standing = StandingValue()
    for part in np.split(COUNTS, cuts):
        standing.take(part * NS, value[part])
    assert ('is its last value repeated?' in standing.clause) == is_asked
    run = value.size - 1 - int(np.flatnonzero(np.append(True, value[1:] != value[:-1]))[-1])
    assert standing.count == run + 1
    assert standing.equal == np.count_nonzero(value[1:] == value[:-1]) - run


@pytest.mark.filterwarnings('error')
def test_numbers_beyond_a_double_print_no_warning() -> None:
    """Differences and products of such numbers are infinite, or none at all."""
    numbers = np.tile([1e308, -1e308, np.inf, np.inf, 1.0, np.nan], 50)
    StandingValue().take(np.arange(numbers.size) * 10**9, numbers)
