# SPDX-License-Identifier: Apache-2.0
"""``python -m benchmarks.score`` of scenes with many seeds."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from shared import ROOT

from benchmarks.score import judge_all
from benchmarks.score import main as score_main
from benchmarks.voyages import OURS, Call, judge
from stickslip_monitor.cli import main

CONFIGS = ROOT / 'launch_configs'
LINING = {'lining_motion': {'disturbance': {'standard_deviation': 0.001, 'unit': 'nominal'}}}


def between(low: float, high: float) -> dict[str, list[float]]:
    return {'between': [low, high]}


def write_scene(path: Path, **changes: Any) -> str:
    """Write a scene of the reference bearing that slows down past both boundaries."""
    document = {
        'scene': 'stickslip_monitor/scene/1',
        'description': 'A test.',
        'duration': 60.0,
        'start': 1_700_000_000_000_000_000,
        'seed': 5,
        'config': str(CONFIGS / 'reference_bearing.yaml'),
        'telemetry': {'speed': {'rate': 5.0}, 'load': {'rate': 5.0}},
        'effects': [
            {'speed_profile': {'unit': 'fold', 'points': [[0, 1.5], [between(30, 40), 0.5]]}},
            {'load_profile': {'unit': 'nominal', 'points': [[0, 1.0]]}},
            {'operating_point': {'rate': 2.0}},
            LINING,
        ],
    }
    content = {key: value for key, value in (document | changes).items() if value is not None}
    path.write_text(yaml.safe_dump(content), 'utf-8')
    return str(path)


@pytest.fixture
def scene(tmp_path: Path) -> str:
    return write_scene(tmp_path / 'slowing.yaml')


def test_json_of_two_seeds_and_two_grades(scene: str, capsys: pytest.CaptureFixture[str]) -> None:
    grades = [str(CONFIGS / 'sensors' / f'{name}.yaml') for name in ('ideal', 'ordinary')]
    args = [part for grade in grades for part in ('--sensors', grade)]
    assert score_main([scene, '--seeds', '2', '--jobs', '1', '--json', *args]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document['schema'] == 'stickslip_monitor/warning_quality/2'
    assert document['seeds'] == {scene: [5, 6]}
    assert [grade['file'] for grade in document['sensors']] == grades
    ideal = document['sensors'][0]
    assert set(ideal['total']) == {'monitor', 'below_fold', 'below_hopf'}
    ours, bare = ideal['total']['monitor'], ideal['total']['below_fold']
    assert (ours['episodes'], ours['missed'], ours['warned']) == (2, 0.0, 1.0)
    assert (bare['episodes'], bare['detected']) == (2, 1.0)
    assert ours == ideal['scenes'][scene]
    # Not said again by a grade of the sensors: the scene's own rates go before.
    assert ours['hours'] == pytest.approx(2 * 60.0 / 3600.0)


@pytest.mark.slow
def test_serial_and_parallel_are_the_same_and_seeds_differ(scene: str) -> None:
    calls = [Call(scene, seed) for seed in (1, 2, 3)]
    serial, parallel = judge_all(calls, 1), judge_all(calls, 2)
    assert serial == parallel
    leads = {voyage.rules[OURS].leads for voyage in serial}
    assert len(leads) == 3


def test_truth_is_that_of_the_bag(scene: str, tmp_path: Path, capsys: Any) -> None:
    """Judge a scene as the recording that is made of it."""
    assert main(['simulate', scene, '-o', str(tmp_path / 'bag')]) == 0
    capsys.readouterr()
    config = str(CONFIGS / 'reference_bearing.yaml')
    score_main([str(tmp_path / 'bag'), '--config', config, '--json'])
    (bag,) = json.loads(capsys.readouterr().out)['bags']
    (voyage,) = judge(Call(scene, None))
    of_bag, of_scene = bag['bearings']['aft_stern']['figures'], voyage.rules[OURS].figures()
    # A recording does not say whether all that happened in it shows in speed and load.
    assert of_bag == of_scene | {'detected_plain': None}


def test_a_table_is_printed(scene: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert score_main([scene, '--jobs', '1']) == 0
    out = capsys.readouterr().out
    for words in ('warned before onset', 'V < V_H', 'slowing', 'false alarms per 100 h'):
        assert words in out


def test_two_publishers_are_reported(tmp_path: Path) -> None:
    path = write_scene(tmp_path / 'two.yaml')
    document = yaml.safe_load(Path(path).read_text('utf-8'))
    publisher = {'second_publisher': {'speed': {'value': 3.0, 'unit': 'fold', 'rate': 5.0}}}
    document['effects'].append(publisher)
    Path(path).write_text(yaml.safe_dump(document), 'utf-8')
    (voyage,) = judge(Call(path, None))
    assert voyage.rules[OURS].wrong_source == 1


CALM = [
    {'speed_profile': {'unit': 'rpm', 'points': [[0, 60]]}},
    {'load_profile': {'unit': 'N', 'points': [[0, 1000]]}},
]


@pytest.mark.parametrize(
    ('changes', 'words'),
    [
        ({'effects': CALM}, 'without the effect operating_point'),
        (
            {
                'effects': [
                    *CALM,
                    {'operating_point': {'rate': 1.0}},
                    {'load_steps': {'unit': 'N', 'steps': [[0, 0], [10, 4000]], 'rise': 1.0}},
                ]
            },
            'without the effect lining_motion it is unknown whether the lining sticks',
        ),
        ({'duration': between(9, 3)}, 'duration.between = [9, 3] must be two numbers, the lower first'),
        ({'parameter_error': {'dampin': 0.1}}, "did you mean 'damping'?"),
        ({'parameter_error': {'mass': 2.0}}, 'mass = 2.0 must be a finite number between 0 and 0.9'),
        ({'config': '.'}, 'must be a folder with a .yaml file'),
    ],
)
def test_bad_input_is_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], changes: dict[str, Any], words: str
) -> None:
    folder = tmp_path / 'scene'
    folder.mkdir()
    changes = changes | ({'config': str(tmp_path)} if changes.get('config') == '.' else {})
    scene = write_scene(folder / 'a.yaml', **changes)
    assert score_main([scene, '--jobs', '1']) == 2
    error = capsys.readouterr().err
    assert error.startswith('ERROR: ')
    assert error.count('\n') == 1
    assert words in error
