# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from sending import configured

from stickslip_monitor.monitor.input_faults import (
    InputFacts,
    Publisher,
    SourceFault,
    SourceFaultKind,
    SourceWatch,
    _Track,
    fault_text,
    input_fault,
    least_gap,
)
from stickslip_monitor.monitor.sample_types import Status

TWO = SourceFaultKind.TWO_LEVELS
SECOND = 10**9
Floats = NDArray[np.float64]


def sample_times(count: int, rate: float = 10.0) -> NDArray[np.int64]:
    return np.rint(np.arange(count) * (SECOND / rate)).astype(np.int64)


def find_mixed_sources(values: Floats, rate: float = 10.0) -> list[SourceFault]:
    time = sample_times(values.size, rate)
    return SourceWatch().take_column(time, values)


def mix_two_levels(count: int, every: int, first: float = 60.0, second: float = 20.0) -> Floats:
    return np.where(np.arange(count) % every == every - 1, second, first)


_VALUE = st.sampled_from([20.0, 60.0, 61.0, 0.0, np.nan, np.inf, -20.0, 1e308, -1e308, 25.0])
_STEP = st.sampled_from([0, 1, SECOND // 10, SECOND, 7 * SECOND, 70 * SECOND])


@settings(max_examples=200, deadline=None)
@given(
    st.lists(st.tuples(_VALUE, _STEP), min_size=0, max_size=12),
    st.integers(1, 8),
    st.sampled_from([0.0, 3.0]),
)
def test_live_and_bulk_raise_the_same_faults(
    pattern: list[tuple[float, int]], repeats: int, min_gap: float
) -> None:
    rows = pattern * repeats
    value = np.array([row[0] for row in rows], float)
    arrival = np.cumsum(np.array([row[1] for row in rows], np.int64))
    watch = SourceWatch(min_gap)
    live: list[SourceFault] = []
    for now, si in zip(arrival.tolist(), value.tolist(), strict=True):
        live += [fault for fault in [watch.take(now, si)] if fault]
        watch.standing_fault(now)  # being asked changes nothing
    bulk, cut = SourceWatch(min_gap), len(rows) // 3
    first, second = (bulk.take_column(arrival[part], value[part]) for part in (slice(cut), slice(cut, None)))
    assert repr([*first, *second]) == repr(live)


@pytest.mark.parametrize(
    ('every', 'rate', 'raised'),
    [
        # Each sample jumps and the second jump is the first to return: 12 returns with the 14th
        # sample at 1.3 s, but no fault before 3 s after the first return at 0.2 s.
        (2, 10.0, 3.2),
        # A tenth of the rate: jumps at samples 9, 10, 19, 20 ...; the 12th return is the 13th.
        (10, 10.0, 6.9),
        # One odd sample in thirty: returns come 1 and 29 samples apart; the 13th jump is at 209.
        (30, 10.0, 20.9),
        # One value in 5 s, from two publishers: the 13th jump is at the 13th sample.
        (2, 0.2, 65.0),
    ],
)
def test_a_second_publisher_is_found(every: int, rate: float, raised: float) -> None:
    (fault,) = find_mixed_sources(mix_two_levels(260, every), rate)
    assert fault.kind is TWO
    assert fault.levels == (20.0, 60.0)
    assert fault.raised_ns == pytest.approx(raised * SECOND, abs=1)


def test_a_speed_ahead_and_astern_is_steady_and_a_load_of_both_signs_is_not() -> None:
    # Of a speed, which has a least gap between levels, the magnitude is watched.
    values = np.array([5.0, -5.0, 5.0])
    assert SourceWatch(0.01).take_steady(values)
    assert not SourceWatch().take_steady(values)


def test_a_counter_of_few_pulses_is_named_as_what_it_is() -> None:
    # One mark a turn at 25 rpm, counted each second, gives 0 or 60 rpm.
    pulses = np.diff(np.floor(np.arange(200) * 25.0 / 60.0))
    time = sample_times(pulses.size, 1.0)
    (fault,) = SourceWatch(3.0).take_column(time, 60.0 * pulses)
    assert (fault.kind, fault.levels) == (SourceFaultKind.FEW_PULSES, (0.0, 60.0))
    # A load may well come and go.
    (fault,) = SourceWatch().take_column(time, 60.0 * pulses)
    assert fault.kind is TWO


@pytest.mark.parametrize(
    ('values', 'min_gap'),
    [
        (1000.0 * (1.0 + 0.2 * np.random.default_rng(2).standard_normal(200_000)), 0.0),
        # A swell of 8 s and a quarter of the load, at 2 Hz.
        (1000.0 + 250.0 * np.sin(2.0 * np.pi * np.arange(5000) / 16.0), 0.0),
        # A pulse counter that toggles between 1 and 2 revolutions a minute.
        (1.0 + np.arange(5000) % 2, 3.0),
        (np.repeat([60.0, 45.0, 60.0, 30.0, 60.0], 600), 0.0),
        (np.linspace(70.0, 0.0, 12), 0.0),
        (np.where(np.arange(600) == 300, 1e6, 60.0), 0.0),
        (np.empty(0), 0.0),
    ],
    ids=['noise', 'swell', 'counter', 'steps', 'stop', 'spike', 'empty'],
)
def test_one_source_is_no_fault(values: Floats, min_gap: float) -> None:
    time = sample_times(values.size)
    assert SourceWatch(min_gap).take_column(time, values) == []


def test_a_fault_stands_for_a_minute_and_clears_when_values_settle() -> None:
    watch = SourceWatch()
    values = [*mix_two_levels(100, 2).tolist(), 20.0, 20.0]
    for k, value in enumerate(values):
        watch.take(k * SECOND // 10, value)
    last = 99 * SECOND // 10
    fault = watch.standing_fault(last + 60 * SECOND)
    assert fault is not None
    assert fault.kind is TWO
    assert watch.standing_fault(last + 60 * SECOND + 1) is None


def test_sentences_of_input_faults() -> None:
    config = configured(load__unit='kN', load__offset=0.5, load__scale=2.0).bearing('aft')
    # Three revolutions a minute of a journal of 0.1 m.
    assert least_gap(config, 0) == pytest.approx(3.0 / 60.0 * np.pi * 0.1)
    assert least_gap(config, 1) == 0.0
    fault = SourceFault(TWO, 0, 0, (600.0, 1500.0))
    assert fault_text(fault, config.load).endswith('(here 0.6 and 1.5 kN)')


FLOAT = 'std_msgs/msg/Float64'
PLC, OTHER = Publisher('/plc', FLOAT), Publisher('/other', FLOAT)
FINE = InputFacts('/speed', FLOAT, False, [PLC], receiving=True)
LOST = replace(FINE, lost=True, receiving=False)


@pytest.mark.parametrize(
    ('facts', 'sentence'),
    [
        (FINE, ''),
        (replace(FINE, behind=1.0), ''),
        (
            replace(LOST, without_clock=True, publishers=[]),
            'use_sim_time is set, but nothing comes on /clock: no input can be used.',
        ),
        (replace(LOST, publishers=[]), 'No publisher on /speed.'),
        (
            replace(LOST, publishers=[Publisher('/plc', 'std_msgs/msg/Float32')]),
            f'/plc publishes std_msgs/msg/Float32 on /speed, but {FLOAT} is configured.',
        ),
        (
            replace(LOST, publishers=[replace(PLC, qos_fault='deadline')]),
            'The quality of service of /plc on /speed does not match: deadline.',
        ),
        (
            replace(LOST, refused=Status.IMPLAUSIBLE),
            'Every sample on /speed is refused: beyond the largest plausible magnitude.',
        ),
        (
            replace(FINE, behind=10.0),
            'Stamps on /speed are 10 s behind their arrival, which counts in their place: late'
            ' messages, or another clock.',
        ),
        (
            replace(FINE, behind=-3600.0),
            'Stamps on /speed are 60.0 min ahead of their arrival, which counts in their place:'
            ' late messages, or another clock.',
        ),
        (LOST, '/plc publishes on /speed, but nothing arrives.'),
        (
            replace(LOST, publishers=[replace(PLC, latched=True)]),
            '/plc publishes on /speed, but nothing arrives: a value that was published once is kept for those'
            ' who ask for durability transient_local and reliability reliable (qos_overrides).',
        ),
        (
            replace(LOST, publishers=[], gone='/plc'),
            'No publisher on /speed: /plc, which published on it, has gone.',
        ),
        (
            replace(LOST, undecodable=True),
            f'Messages on /speed cannot be decoded: its sender has another definition of {FLOAT}.',
        ),
        # What can never connect, or sends nothing, mixes no values.
        (replace(FINE, publishers=[PLC, replace(OTHER, type='std_msgs/msg/Float32')]), ''),
        (replace(FINE, publishers=[PLC, replace(OTHER, qos_fault='deadline')]), ''),
        (replace(FINE, publishers=[PLC, replace(OTHER, sends=False)]), ''),
        (
            replace(FINE, share=29 / 30, reason=Status.NOT_FINITE),
            '97% of the samples on /speed are refused, most because: not a finite number.',
        ),
        (replace(FINE, share=0.3, reason=Status.NOT_FINITE), ''),
        (replace(FINE, stuck=True), 'The level on /speed never changes: its sensor is stuck.'),
        (
            replace(FINE, publishers=[PLC, OTHER], source='two levels'),
            '2 publishers send on /speed (/other, /plc): their values are mixed.',
        ),
        (replace(FINE, source='values jump'), 'On /speed, values jump.'),
    ],
)
def test_the_most_fundamental_fault_is_reported(facts: InputFacts, sentence: str) -> None:
    assert input_fault(facts) == sentence


def alternate_levels(common: int, rare: int, count: int = 3000, rare_value: float = 600.0) -> Floats:
    return np.where(np.arange(count) % (common + rare) < common, 30.0, rare_value)


@pytest.mark.parametrize(
    ('common', 'rare'), [(136, 1), (580, 20), (49, 1), (9, 1), (1, 1), (3, 1), (2, 2), (40, 20)]
)
def test_the_share_of_the_rarer_level_decides_whether_it_is_a_mix(common: int, rare: int) -> None:
    values = alternate_levels(common, rare, 20 * (common + rare))
    watch, time = SourceWatch(3.0), sample_times(values.size)
    watch.take_column(time, values)
    fault = watch.standing_fault(int(time[-1]))
    assert fault is not None
    assert fault.share == pytest.approx(rare / (common + rare))
    assert fault.is_mixed == (rare / (common + rare) >= 0.2)


def test_the_share_follows_a_source_that_becomes_frequent() -> None:
    values = np.concatenate([alternate_levels(49, 1), alternate_levels(1, 1, 200)])
    watch, time = SourceWatch(), sample_times(values.size)
    watch.take_column(time[:3000], values[:3000])
    rare = watch.standing_fault(int(time[2999]))
    watch.take_column(time[3000:], values[3000:])
    frequent = watch.standing_fault(int(time[-1]))
    assert rare is not None
    assert frequent is not None
    assert (rare.is_mixed, frequent.is_mixed) == (False, True)


@pytest.mark.parametrize('spike', [400.0, 0.0, 90.0, -3.0, 0.1])
@pytest.mark.parametrize(('rpm', 'stepped'), [(150.0, 60.0), (60.0, 150.0)])
def test_rare_spikes_are_no_mix_when_the_speed_steps(rpm: float, stepped: float, spike: float) -> None:
    # One value in 137 is a spike, of a fixed value or by a factor below 1; the speed steps amid two of them.
    index = np.arange(137 * 60)
    values = np.where(index < 137 * 30 + 60, rpm, stepped)
    values[136::137] = spike * values[136::137] if abs(spike) in (3.0, 0.1) else spike
    watch, shares = SourceWatch(3.0), []
    for now, value in zip(sample_times(values.size, 7.0).tolist(), values.tolist(), strict=True):
        watch.take(now, value)
        fault = watch.standing_fault(now)
        shares += [] if fault is None else [fault.share]
    assert len(shares) > 137 * 40
    assert shares == pytest.approx([1.0 / 137.0] * len(shares))


def test_signs_of_a_speed_are_no_second_level() -> None:
    # The rule takes the magnitude of a speed; two loads of opposite sign are two levels.
    values = alternate_levels(49, 1, rare_value=-30.0)
    time = sample_times(values.size)
    assert [bool(SourceWatch(gap).take_column(time, values)) for gap in (3.0, 0.0)] == [False, True]


@pytest.mark.parametrize(
    ('findings', 'expected'),
    [
        (['', 'a 1', 'a 2', 'a 3', 'a 4', ''], ['a 3', 'over: a 4']),
        # A sender is being discovered: three looks, and three causes.
        (['No publisher.', 'n is silent.', 'n is of another type.', ''], []),
        (['a', 'a', 'b', 'b', 'a', 'a'], []),
        (['a', 'a', 'a', 'b', 'b', 'b', ''], ['a', 'b', 'over: b']),
        (['a', 'a', '', 'a', 'a', ''], []),
        (['a', 'a', 'a', '', 'a', 'a', 'a'], ['a', 'over: a', 'a']),
    ],
)
def test_a_fault_is_reported_after_three_findings_of_one_cause_and_withdrawn(
    findings: list[str], expected: list[str]
) -> None:
    track = _Track(SourceWatch())
    texts = [track.take_fault(fault) for fault in findings]
    assert [f'{"over: " * is_over}{text}' for text, is_over in texts if text] == expected


def test_a_mix_goes_on_down_to_a_tenth_of_the_values() -> None:
    # One value in four is a mix and goes on at one in seven; one in seven alone is none, one in 21 ends it.
    def share_of(watch: SourceWatch, start: int, majority: int, rounds: int) -> bool:
        fault = None
        for k in range(rounds * (majority + 1)):
            rpm = 20.0 if k % (majority + 1) == majority else 60.0
            watch.take((start + k) * 10**8, rpm)
            fault = watch.standing_fault((start + k) * 10**8)
        assert fault is not None
        return fault.is_mixed

    watch = SourceWatch(1.0)
    assert share_of(watch, 0, 3, 20)
    assert share_of(watch, 80, 6, 20)
    assert not share_of(watch, 220, 20, 20)
    assert not share_of(SourceWatch(1.0), 0, 6, 20)
