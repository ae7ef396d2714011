# SPDX-License-Identifier: Apache-2.0
"""What a clip holds: counted by hand at one message a second."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sending import change

from stickslip_monitor.monitor.clip_recorder import Clip, ClipMessage, ClipRecorder
from stickslip_monitor.monitor.parameters import ClipConfig
from stickslip_monitor.monitor.severity import Condition
from stickslip_monitor.monitor.statements import Event

NS, T0 = 10**9, 1_777_874_400
AROUND = 10
CONFIG = ClipConfig('folder', AROUND * NS, 5, 5_000_000)


def clip_message(second: float, size: int = 0) -> ClipMessage:
    return ClipMessage(round((T0 + second) * NS), '/a', 'std_msgs/msg/Float64', bytes(size))


def condition_change(
    second: float,
    new_condition: Condition = Condition.STICK_SLIP,
    old_condition: Condition = Condition.NORMAL,
    bearing: str = 'aft',
) -> Event:
    return change(round((T0 + second) * NS), old_condition, new_condition, bearing=bearing)


def clip_seconds(clip: Clip) -> list[int]:
    return [m.time_ns // NS - T0 for m in clip.messages]


def record_clips(recorder: ClipRecorder, stop: int, *events: Event, size: int = 0) -> list[Clip]:
    """Record one message a second up to ``stop``, and each event after the message of its second."""
    clips = []
    for second in range(stop):
        recorder.add(clip_message(second, size))
        for event in events:
            if event.time_ns // NS - T0 == second:
                recorder.note(event)
        clips += recorder.pop_clips()
    return clips


def test_a_clip_has_the_time_before_and_after() -> None:
    (clip,) = record_clips(ClipRecorder(CONFIG), 100, condition_change(50))
    assert clip_seconds(clip) == list(range(40, 61))
    assert (clip.bearing, clip.condition) == ('aft', Condition.STICK_SLIP)
    assert clip.time_ns == (T0 + 50) * NS


def test_a_further_alarm_lengthens_it() -> None:
    (clip,) = record_clips(
        ClipRecorder(CONFIG), 100, condition_change(50), condition_change(55, Condition.AMPLITUDE)
    )
    assert clip_seconds(clip) == list(range(40, 66))
    assert clip.condition is Condition.STICK_SLIP


def test_a_later_alarm_has_its_own_and_they_overlap() -> None:
    first, second = record_clips(ClipRecorder(CONFIG), 100, condition_change(50), condition_change(65))
    assert clip_seconds(first) == list(range(40, 61))
    assert clip_seconds(second) == list(range(55, 76))


@pytest.mark.parametrize(
    ('old_condition', 'new_condition', 'count'),
    [
        (Condition.NORMAL, Condition.CAUTION, False),
        (Condition.NORMAL, Condition.BISTABLE, False),
        (Condition.BISTABLE, Condition.STICK_SLIP, True),
        (Condition.NORMAL, Condition.INPUT_STALE, True),
        (Condition.AMPLITUDE, Condition.STICK_SLIP, False),
        (Condition.INPUT_STALE, Condition.STICK_SLIP, False),
        (Condition.STICK_SLIP, Condition.NORMAL, False),
    ],
)
def test_alarms_begin_clips_and_nothing_else(
    old_condition: Condition, new_condition: Condition, count: bool
) -> None:
    assert (
        len(record_clips(ClipRecorder(CONFIG), 100, condition_change(50, new_condition, old_condition)))
        == count
    )


def test_without_messages_time_ends_it() -> None:
    recorder = ClipRecorder(CONFIG)
    record_clips(recorder, 21, condition_change(20))
    recorder.advance((T0 + 30) * NS)
    assert recorder.pop_clips() == []
    recorder.advance((T0 + 30) * NS + 1)
    (clip,) = recorder.pop_clips()
    assert clip_seconds(clip) == list(range(10, 21))


def test_a_clock_that_jumps_back_ends_a_clip_and_starts_another() -> None:
    recorder = ClipRecorder(CONFIG)
    record_clips(recorder, 53, condition_change(50))
    clips = record_clips(recorder, 30, condition_change(5))
    assert [clip_seconds(clip) for clip in clips] == [list(range(40, 53)), list(range(16))]


def test_disorder_within_the_time_of_a_clip_is_no_jump() -> None:
    recorder = ClipRecorder(CONFIG)
    record_clips(recorder, 50)
    recorder.add(clip_message(45))
    recorder.note(condition_change(49))
    recorder.advance((T0 + 60) * NS)
    (clip,) = recorder.pop_clips()
    assert clip_seconds(clip) == [*range(39, 50), 45]


@pytest.mark.slow
@given(st.integers(1, 3000), st.integers(10_000, 60_000))
def test_memory_and_size_are_bounded(message_size: int, max_size: int) -> None:
    config = ClipConfig('folder', 10**6 * NS, 5, max_size)
    clips = record_clips(ClipRecorder(config), 200, condition_change(100), size=message_size)
    recorder = ClipRecorder(config)
    record_clips(recorder, 200, condition_change(100), size=message_size)
    recorder.finish()
    for clip in clips + recorder.pop_clips():
        total = sum(m.size for m in clip.messages)
        assert total < max_size + message_size + 200
        assert any(m.time_ns == (T0 + 100) * NS for m in clip.messages)
    past_sizes = [m.size for m in recorder._past]
    assert sum(past_sizes) <= max_size // 2 + message_size + 200


def test_definitions_that_came_until_then_are_in_the_clip() -> None:
    definitions: dict[str, str] = {}
    recorder = ClipRecorder(CONFIG, definitions)
    recorder.add(clip_message(0))
    recorder.note(condition_change(0))
    definitions['a/msg/B'] = 'int8 x\n'
    recorder.finish()
    (clip,) = recorder.pop_clips()
    definitions['a/msg/C'] = 'int8 x\n'
    assert clip.definitions == {'a/msg/B': 'int8 x\n'}
