# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from stickslip_monitor.monitor.input_watch import InputFacts, Publisher, input_fault
from stickslip_monitor.monitor.signals import Status
from stickslip_monitor.monitor.source_faults import StampGaps

FLOAT = 'std_msgs/msg/Float64'
PLC, OTHER = Publisher('/plc', FLOAT), Publisher('/other', FLOAT)
FINE = InputFacts('/speed', FLOAT, 5.0, False, [PLC], receiving=True, other='/load')
LOST = replace(FINE, lost=True, receiving=False)


@pytest.mark.parametrize(
    ('facts', 'sentence'),
    [
        (FINE, ''),
        (replace(FINE, behind=4.9), ''),
        (
            replace(LOST, without_clock=True, publishers=[]),
            'use_sim_time is set, but nothing comes on /clock: no sample can be used.',
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
            replace(FINE, lost=True, behind=10.0),
            'Stamps on /speed are 10 s behind those on /load, which is more than the timeout of'
            " 5 s: the senders' clocks differ.",
        ),
        (LOST, '/plc publishes on /speed, but nothing arrives.'),
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


def stamps(period_ms: int, count: int) -> Any:
    return (1_700_000_000_000 + period_ms * np.arange(count)) * 1_000_000


@pytest.mark.parametrize('seed', range(3))
def test_every_message_missing_from_a_steady_sender_is_counted(seed: int) -> None:
    """With clock jitter of 5 % of the period, and up to 40 messages missing at random."""
    rng = np.random.default_rng(seed)
    sent = stamps(100, 1000) + rng.integers(-5_000_000, 5_000_000, 1000)
    # The period is known after eight intervals; a gap is sure once the period is seen again.
    gone = rng.choice(np.arange(20, 990), 40, replace=False)
    gaps = StampGaps(longest_ns=5 * 10**9)
    for stamp in np.delete(sent, gone).tolist():
        gaps.add(stamp)
    assert gaps.missing == 40


@pytest.mark.parametrize(
    'stream',
    [
        # The sender changes its rate.
        np.concatenate([stamps(100, 50), stamps(100, 50)[-1] + stamps(200, 50) - stamps(200, 1)]),
        # An outage is not a loss of messages.
        np.concatenate([stamps(100, 50), stamps(100, 50) + 60 * 10**9]),
        # No period is known.
        np.cumsum(np.random.default_rng(1).integers(1, 10**9, 200)) + 10**18,
        # A replay starts over.
        np.concatenate([stamps(100, 50), stamps(100, 50)]),
    ],
)
def test_nothing_is_missing(stream: Any) -> None:
    gaps = StampGaps(longest_ns=5 * 10**9)
    for stamp in stream.tolist():
        gaps.add(stamp)
    assert gaps.missing == 0
