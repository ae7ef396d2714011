# SPDX-License-Identifier: Apache-2.0
"""What every effect owes: an example in the docs, a stream of its own, nothing when not listed."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from stickslip_lab.scenes import effects as effect_module
from stickslip_lab.scenes import lining_effects
from stickslip_lab.scenes.scene import EFFECTS, KEYS, STAGES, Scene, load_scene, write_bag
from stickslip_lab.scenes.settings import random_stream
from stickslip_lab.scenes.telemetry import Messages
from stickslip_monitor.monitor.sample_types import INPUTS

MakeScene = Callable[..., Scene]
MessagesOf = Callable[..., dict[str, Messages]]
PAGE = Path(__file__).resolve().parents[2] / 'docs' / 'scenes.md'
RATES = {'speed': {'rate': 10.0}, 'load': {'rate': 2.0}, 'level': {'rate': 2.0}}


def documented_examples() -> dict[str, Any]:
    """Return the example of each effect in the docs."""
    blocks = re.findall(r'```yaml\n(- .*?)```', PAGE.read_text('utf-8'), flags=re.DOTALL)
    listed = [entry for block in blocks for entry in yaml.safe_load(block)]
    settings_by_effect = {name: settings for entry in listed for name, settings in entry.items()}
    assert len(settings_by_effect) == len(listed)
    return settings_by_effect


EXAMPLES = documented_examples()
# Of the effects that draw random numbers, the integrator's takes seconds.
QUICK = [name for name in EXAMPLES if name != 'lining_motion']
ALL = [{name: EXAMPLES[name]} for name in QUICK]


def test_every_effect_has_an_example_and_its_place() -> None:
    assert sorted(EXAMPLES) == sorted(EFFECTS)
    rows = re.findall(r'^\| `(\w+)` \|.*\| ((?:`\w+`(?:, )?)+) \|$', PAGE.read_text('utf-8'), re.M)
    stages = {stage: tuple(re.findall(r'\w+', names)) for stage, names in rows}
    assert stages == dict(STAGES)
    assert list(stages) == list(STAGES)
    settings = PAGE.read_text('utf-8').partition('\n## Effects')[2]
    words = set(re.findall(r'\w+', settings))
    assert words >= set(EFFECTS)
    for name in set(EFFECTS) - set(STAGES['lining']):
        keys = set(EFFECTS[name].keys)
        assert words >= keys - {'bearing', *INPUTS}


def test_scene_of_the_page_can_be_made(tmp_path: Path) -> None:
    (text,) = re.findall(r'```yaml\n(scene: .*?)```', PAGE.read_text('utf-8'), flags=re.DOTALL)
    (tmp_path / 'docs').mkdir()
    (tmp_path / 'launch_configs').symlink_to(PAGE.parents[1] / 'launch_configs')
    path = tmp_path / 'docs' / 'scene.yaml'
    path.write_text(text, 'utf-8')
    scene = load_scene(path)
    counts = write_bag(scene, tmp_path / 'bag')
    assert counts == {'/shaft/speed': 6001, '/bearing/aft_stern/load': 1201 - 20 * 2}
    keys = PAGE.read_text('utf-8').partition('## Scenes that vary')[0]
    heads = re.findall(r'^- ((?:`\w+`(?:, )?)+): ', keys, re.M)
    assert {*yaml.safe_load(text), *re.findall(r'\w+', ' '.join(heads))} == set(KEYS)


def test_order_in_the_file_and_length_of_the_blocks_change_no_bit(
    make_scene: MakeScene, messages_of: MessagesOf
) -> None:
    scene = make_scene('watered', effects=ALL, telemetry=RATES)
    assert [s.name for s in scene.effects] == [n for n in EFFECTS if n in QUICK]
    expected = messages_of(scene)
    backwards = make_scene('watered', effects=ALL[::-1], telemetry=RATES)
    for repeated in (messages_of(backwards), *(messages_of(scene, t) for t in (1000.0, 0.35))):
        for topic, messages in expected.items():
            for name in ('stamp_ns', 'log_time_ns', 'raw'):
                values, repeated_values = (getattr(run, name) for run in (messages, repeated[topic]))
                assert values.tobytes() == repeated_values.tobytes()


@pytest.fixture
def streams(monkeypatch: pytest.MonkeyPatch) -> dict[tuple[str, ...], np.random.Generator]:
    """Return the random streams that are made, by name; their states tell what was drawn."""
    streams: dict[tuple[str, ...], np.random.Generator] = {}

    def make_stream(seed: int, *names: str) -> np.random.Generator:
        streams[names] = random_stream(seed, *names)
        return streams[names]

    for module in (effect_module, lining_effects):
        monkeypatch.setattr(module, 'random_stream', make_stream)
    return streams


# A recording that is cut off ends sooner, and so do all its streams.
@pytest.mark.parametrize('name', [name for name in QUICK if name != 'cut_off'])
def test_leaving_an_effect_out_changes_no_stream_of_another(
    make_scene: MakeScene,
    messages_of: MessagesOf,
    streams: dict[tuple[str, ...], np.random.Generator],
    name: str,
) -> None:
    def drawn(effects: list[dict[str, Any]]) -> dict[tuple[str, ...], Any]:
        scene = make_scene('watered', effects=effects, telemetry=RATES)
        streams.clear()
        messages_of(scene)
        return {key: stream.bit_generator.state for key, stream in streams.items()}

    full = drawn(ALL)
    less = drawn([effect for effect in ALL if name not in effect])
    assert less == {key: state for key, state in full.items() if key[0] != name}
    fresh = {key: random_stream(7, *key).bit_generator.state for key in full}
    used = {key[0] for key in full if full[key] != fresh[key]}
    assert used == {
        'load_in_waves',
        'sensor_noise',
        'spikes',
        'not_a_number',
        'clock_jitter',
        'out_of_order',
        'repeated_stamps',
        'dropout',
        'vibration_background',
    }
