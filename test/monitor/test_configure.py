# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import contextlib
import copy
import json
import os
import random
from pathlib import Path
from typing import Any

import pytest

from stickslip_monitor.errors import ConfigurationError, StickslipError
from stickslip_monitor.lab.calibration import (
    known_recordings,
    parameters_of_law,
    prior_from,
    prior_with_bench,
)
from stickslip_monitor.monitor.configure import belief_of, load_calibration, require_same_sensors
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import Stribeck
from stickslip_monitor.physics.probability import EXACT

BEARING = Bearing(50.0, 400.0, 2.0e6, Stribeck(0.30, 0.10, 10.0), 0.100)
SENSOR = {'topic': '/a', 'field': 'data', 'scale': 1.0, 'offset': 0.0, 'unit': 'rpm'}
RESULT: dict[str, Any] = {
    'schema': 'stickslip_monitor/calibration/2',
    'bearing': 'aft',
    'inputs': {'speed': SENSOR},
    'parameters': parameters_of_law(BEARING),
    'configured': parameters_of_law(BEARING),
    'factors': {'speeds': 1.1, 'loads': 0.9},
    'covariance': [[0.01, 0.0], [0.0, 0.02]],
    'loads': [500.0, 1500.0],
    'floor': 0.01,
    'recordings': ['977faaa6'],
}
FIT: dict[str, Any] = {
    'schema': 'stickslip_monitor/fit/1',
    'friction': {'law': 'stribeck', 'static': 0.3, 'kinetic': 0.1, 'decay': 10.0, 'viscous': 0.0},
    'estimated': ['static', 'kinetic', 'decay'],
    'covariance': [[1e-5, 0.0, 0.0], [0.0, 1e-5, 0.0], [0.0, 0.0, 0.1]],
}
ODD = (None, True, 'x', '', [], {}, [[]], -1, 0, 1e308, float('nan'), float('inf'), 10**400)


def mutated(document: Any, source: random.Random) -> Any:
    """A copy with one value, at any depth, replaced, left out or given twice."""
    result = copy.deepcopy(document)
    place, parent = None, result
    while isinstance(parent, dict | list) and parent and (place is None or source.random() < 0.7):
        keys = list(parent) if isinstance(parent, dict) else list(range(len(parent)))
        place = (parent, source.choice(keys))
        parent = parent[place[1]]
    assert place is not None
    container, key = place
    if source.random() < 0.3:
        del container[key]
    else:
        container[key] = copy.deepcopy(source.choice(ODD))
    return result


@pytest.mark.parametrize('kind', [RESULT, FIT])
def test_damaged_files_are_refused_in_a_sentence(tmp_path: Path, kind: dict[str, Any]) -> None:
    source, path, read = random.Random(1), tmp_path / 'result.json', 0
    for _ in range(150):
        path.write_text(json.dumps(mutated(kind, source)))
        with contextlib.suppress(StickslipError):
            if kind is FIT:
                prior_with_bench(BEARING, EXACT, 'fit', json.loads(path.read_text()))
            else:
                document = load_calibration(path)
                require_same_sensors(path, document, 'aft', {'speed': SENSOR})
                prior_from('result', document, BEARING)
                known_recordings('result', document)
                belief_of(path, document, BEARING, EXACT)
            read += 1
    assert 0 < read < 150


@pytest.mark.parametrize('kind', ['pipe', 'device', 'nested'])
def test_what_is_no_file_of_results_is_not_read_for_ever(tmp_path: Path, kind: str) -> None:
    path = tmp_path / 'given'
    if kind == 'pipe':
        os.mkfifo(path)
    elif kind == 'device':
        path.symlink_to('/dev/zero')
    else:
        path.write_text('[' * 100_000)
    with pytest.raises(ConfigurationError, match=r'it is a pipe|it is a device|nested too deeply'):
        load_calibration(path)
