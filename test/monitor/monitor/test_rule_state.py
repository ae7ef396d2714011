# SPDX-License-Identifier: Apache-2.0
"""What is remembered of a bearing survives a restart, and nothing damaged is taken for it."""

from __future__ import annotations

import json
import math
import re
from dataclasses import fields
from typing import Any

import pytest
from sending import configured, every

from stickslip_monitor import Monitor, Sample
from stickslip_monitor.monitor.rule_state import NEVER, STATE_TYPE, State
from stickslip_monitor.monitor.sample_types import INPUTS, Input


def sticking_memory() -> dict[str, Any]:
    """Return the memory after half a minute at 20 rpm, as JSON."""
    monitor = Monitor(configured())
    messages = every(Input.SPEED, 0.2, 30.0, 20.0) + every(Input.LOAD, 0.2, 30.0, 1000.0)
    for message in sorted(messages):
        time_ns = round(message.stamp * 1e9)
        monitor.update(Sample('aft', INPUTS[message.place], time_ns, message.value))
    return json.loads(json.dumps(monitor.bearings['aft'].state.record()))


def test_it_survives_json_a_copy_and_a_row() -> None:
    record = sticking_memory()
    state = State.of_record(record)
    assert state.sticking == 1
    for copied in (state.copy(), State.of_row(state.row()[0]), State.of_record(record)):
        assert repr(copied) == repr(state)
    assert state.copy().count is not state.count


def test_it_is_below_72_numbers() -> None:
    assert STATE_TYPE.itemsize < 72 * 8


ODD = ('text', True, 2**63, -(2**63), math.inf, [], [1] * 6, {}, 1e300, -1e300)


@pytest.mark.parametrize('name', [row.name for row in fields(State)])
def test_a_field_out_of_its_range_is_refused_by_name(name: str) -> None:
    for damage in ODD:
        with pytest.raises(ValueError, match=f'^{name} = '):
            State.of_record(_STICKING | {name: damage})


NO_MEANING = {
    'vibrating': 3,
    'course': -1,
    'raised': 32,
    'sticking': 2,
    'can': 1.5,
    'growth': -1.0,
    'still': -1,
}


@pytest.mark.parametrize(('name', 'value'), NO_MEANING.items())
def test_a_value_of_no_meaning_is_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f'^{name} = {value!r} must be from'):
        State.of_record(_STICKING | {name: value})


@pytest.mark.parametrize('record', [None, 7, 'aft', []])
def test_a_record_that_is_no_object_is_refused(record: object) -> None:
    with pytest.raises(ValueError, match=f'^{re.escape(repr(record))} is no object$'):
        State.of_record(record)


def test_a_missing_part_is_refused() -> None:
    with pytest.raises(ValueError, match=r'^sticking = None must be'):
        State.of_record({key: value for key, value in _STICKING.items() if key != 'sticking'})


def test_a_memory_of_0_2_0_is_restored() -> None:
    """Restore a memory with three parts of a waiting stamp, and no background, shift or count of onsets."""
    missing = ('shift', 'onsets', 'still', 'background', 'high_for', 'doubt', 'heard')
    old = {key: value for key, value in _STICKING.items() if key not in missing}
    old |= {'came': [0, 0], 'odd': [NEVER] * 3, 'agreed': [0, 0, 0], 'spell': NEVER, 'unsure': 0.0}
    state = State.of_record(old)
    assert (state.sticking, state.raised) == (_STICKING['sticking'], _STICKING['raised'])
    assert state.value == _STICKING['value']
    assert (state.shift, state.heard, len(state.came)) == (0, 0, 4)
    with pytest.raises(ValueError, match=r'^raised = 99 must be'):
        State.of_record(old | {'raised': 99})


def test_a_memory_without_later_parts_is_restored() -> None:
    later = ('water', 'viscosity_ratio', 'beyond_for', 'grown_before')
    old = {key: value for key, value in _STICKING.items() if key not in later}
    old |= {key: old[key][:3] for key in ('stamp', 'came', 'gap', 'pace')}
    state, current = State.of_record(old), State.of_record(_STICKING)
    assert (state.came, state.gap, state.viscosity_ratio) == (current.came, current.gap, 1.0)
    assert (state.beyond_for, state.grown_before) == (0, 0.0)
    with pytest.raises(ValueError, match=r'^came = '):
        State.of_record(old | {'came': [0, 0]})


_STICKING = sticking_memory()
