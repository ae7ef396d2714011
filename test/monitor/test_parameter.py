# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.monitor.config import BEARING_PARAMETERS, NODE_PARAMETERS
from stickslip_monitor.monitor.parameter import REQUIRED, Parameter
from stickslip_monitor.monitor.signals import INPUTS

ROWS = {p.name: p for p in (*NODE_PARAMETERS, *BEARING_PARAMETERS)}


def test_every_default_keeps_its_own_rule() -> None:
    for row in ROWS.values():
        if row.default is not REQUIRED and not row.optional:
            assert row.checked(row.name, {row.name: row.default}) == row.default


def test_only_thresholds_scales_and_timeouts_are_live() -> None:
    live = {p.name for p in (*NODE_PARAMETERS, *BEARING_PARAMETERS) if p.live}
    inputs = {f'{q}.{x}' for q in INPUTS for x in ('scale', 'offset', 'timeout', 'maximum')} | {
        'load.minimum',
        'level.threshold',
        'level.hysteresis',
    }
    alarm = {p.name for p in BEARING_PARAMETERS if p.name.startswith('alarm.')}
    assert live == inputs | alarm | {'publish_period', 'shelve_time', 'silence_time'}


@pytest.mark.parametrize(
    ('kind', 'value', 'plain'),
    [
        ('float', np.int64(3), 3.0),
        ('float[]', np.array([0.0, 1.5]), (0.0, 1.5)),
        ('int', 10**400, 10**400),
        ('float', np.bool_(True), None),
        ('int', 3.0, None),
    ],
)
def test_a_number_of_numpy_becomes_a_plain_one(kind: str, value: Any, plain: Any) -> None:
    row = Parameter('x', kind, 1, '')
    if plain is None:
        with pytest.raises(ConfigurationError, match=r'^x = '):
            row.checked('x', {'x': value})
    else:
        found = row.checked('x', {'x': value})
        assert (found, type(found)) == (plain, type(plain))
