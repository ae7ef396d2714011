# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from dataclasses import replace

import pytest

from stickslip_monitor.monitor.input_watch import InputFacts, Publisher, input_fault
from stickslip_monitor.monitor.signals import Status

FLOAT = 'std_msgs/msg/Float64'
PLC, OTHER = Publisher('/plc', FLOAT), Publisher('/other', FLOAT)
FINE = InputFacts('/speed', FLOAT, 5.0, False, [PLC], receiving=True)
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
            'Stamps on /speed are 3.6e+03 s ahead of their arrival, which counts in their place:'
            ' late messages, or another clock.',
        ),
        (LOST, '/plc publishes on /speed, but nothing arrives.'),
        (
            replace(LOST, publishers=[replace(PLC, latched=True)]),
            '/plc publishes on /speed, but nothing arrives: a value that was published once is'
            ' kept for those who ask for durability transient_local and reliability reliable'
            ' (qos_overrides).',
        ),
        (
            replace(LOST, publishers=[], gone='/plc'),
            'No publisher on /speed: /plc, which published on it, has gone.',
        ),
        (
            replace(LOST, undecodable=True),
            f'Messages on /speed cannot be decoded: its sender has another definition of {FLOAT}.',
        ),
        # What can never connect mixes no values.
        (replace(FINE, publishers=[PLC, replace(OTHER, type='std_msgs/msg/Float32')]), ''),
        (replace(FINE, publishers=[PLC, replace(OTHER, qos_fault='deadline')]), ''),
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
def test_the_most_fundamental_fault_is_told(facts: InputFacts, sentence: str) -> None:
    assert input_fault(facts) == sentence
