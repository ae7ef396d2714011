# SPDX-License-Identifier: Apache-2.0
"""The state of a bearing, read back from its diagnostic status.

Live and in a replay the dashboard is fed with the same texts, so that it has one way in.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from stickslip_monitor.monitor.signals import QUANTITIES, Status

NUMBERS = {
    'speed': 'speed [m/s]',
    'rpm': 'shaft speed [rpm]',
    'load': 'load [N]',
    'hopf_speed': 'hopf speed [m/s]',
    'fold_speed': 'fold speed [m/s]',
    'hopf_margin': 'hopf margin',
    'fold_margin': 'fold margin',
    'growth_rate': 'growth rate [1/s]',
    'amplitude': 'amplitude [m]',
    'amplitude_exact': 'amplitude of the exact cycle [m]',
    'threshold_amplitude': 'threshold amplitude [m]',
}
"""The numbers of an operating point, by the keys of the diagnostics that they come from."""
STATUSES = {status.name.lower(): status.name.lower().replace('_', ' ') for status in Status}
BELIEVED = [status.name.lower() for status in Status if status.believed]


@dataclass(frozen=True, slots=True)
class BearingStatus:
    """A bearing at an instant.

    Attributes:
        time_ns: When, on the clock of the monitor [ns].
        text: What the monitor says, for a person.
        words: ``reason``, ``regime`` and ``outcome``; those that are known.
        sticking: Whether stick-slip is predicted; ``None`` before the first operating point.
        numbers: By the names of :data:`NUMBERS`; those that are known, ``inf`` and ``nan`` too.
        ages: Ages of the inputs that are lost [s].
        counts: Samples of each input by status.
    """

    time_ns: int
    text: str
    words: dict[str, str]
    sticking: bool | None
    numbers: dict[str, float]
    ages: dict[str, float]
    counts: dict[str, dict[str, int]]

    def believed(self, quantity: str) -> int:
        """Samples of an input that were used."""
        return sum(self.counts.get(quantity, {}).get(name, 0) for name in BELIEVED)


def read_status(time_ns: int, text: str, values: Mapping[str, str]) -> BearingStatus:
    """Read a diagnostic status; what is not there, or no number, is left out.

    Args:
        time_ns: Its time stamp [ns].
        text: Its message.
        values: Its key-value pairs.
    """
    sticking = values.get('stick-slip predicted')
    counts = {
        quantity: {
            name: int(count)
            for name, words in STATUSES.items()
            if (count := _number(values, f'{quantity} samples {words}')) is not None
            and math.isfinite(count)
        }
        for quantity in QUANTITIES
    }
    return BearingStatus(
        time_ns,
        text,
        {word: values[word] for word in ('reason', 'regime', 'outcome') if word in values},
        None if sticking is None else sticking == 'true',
        _numbers(values, NUMBERS),
        _numbers(values, {quantity: f'{quantity} age [s]' for quantity in QUANTITIES}),
        counts,
    )


def _numbers(values: Mapping[str, str], keys: Mapping[str, str]) -> dict[str, float]:
    found = {name: _number(values, key) for name, key in keys.items()}
    return {name: number for name, number in found.items() if number is not None}


def _number(values: Mapping[str, str], key: str) -> float | None:
    try:
        return float(values[key])
    except (KeyError, ValueError):
        return None


def status_record(status: BearingStatus) -> dict[str, Any]:
    """A status for the page; ``null`` where a number has no value."""
    numbers = {name: _finite(status.numbers.get(name)) for name in NUMBERS}
    return {
        'time': status.time_ns // 1_000_000,
        'text': status.text,
        'reason': status.words.get('reason', 'waiting'),
        'regime': status.words.get('regime'),
        'outcome': status.words.get('outcome'),
        'sticking': status.sticking,
        **numbers,
        'inputs': {
            quantity: {
                'lost': quantity in status.ages,
                'age': _finite(status.ages.get(quantity)),
                'counts': counts,
            }
            for quantity, counts in status.counts.items()
        },
    }


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
