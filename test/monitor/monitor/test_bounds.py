# SPDX-License-Identifier: Apache-2.0
"""No value that a parameter may have breaks the monitor: another machine may set it."""

from __future__ import annotations

import json
import math
import warnings
from typing import Any

import pytest
from sending import Ship
from shared import REFERENCE

from stickslip_monitor import build_config
from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.monitor.bearing_records import diagnostic_record
from stickslip_monitor.monitor.parameters import BEARING_PARAMETERS

GIVEN = {'level.topic': '/level', 'alarm.amplitude_limit': 0.5e-3, **REFERENCE}
FLOATS = [
    row
    for row in BEARING_PARAMETERS
    if row.kind == 'float' and not row.name.startswith(('inertia', 'torsional', 'load.constant'))
]
ENDS = [
    (row.name, end)
    for row in FLOATS
    for end in (row.minimum + 1e-9 * row.above_minimum, row.maximum)
    if math.isfinite(end)
]


def test_every_number_of_a_bearing_has_bounds() -> None:
    """But the limit of the amplitude, which is none by default."""
    open_ended = {row.name for row in FLOATS if not math.isfinite(row.minimum + row.maximum)}
    assert open_ended == {'alarm.amplitude_limit'}


@pytest.mark.slow
@pytest.mark.parametrize(('name', 'end'), ENDS)
def test_at_the_bounds_of_a_parameter_the_monitor_works(name: str, end: float) -> None:
    values: dict[str, Any] = {f'aft.{key}': value for key, value in GIVEN.items()}
    values |= {'bearings': ['aft'], f'aft.{name}': end}
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        try:
            config = build_config(values)
        except ConfigurationError:
            return  # a rule that spans several
        ship = Ship(config)
        for rpm in (60.0, 20.0, 0.0, 20.0):
            ship.sail(4.0, rpm)
        ship.session.show(ship.now)
        for state in ship.standing:
            assert diagnostic_record('monitor', state).message
    assert all(json.dumps(record, allow_nan=False) for record in ship.published)
