# SPDX-License-Identifier: Apache-2.0
"""Make the recordings of bags/ and their manifest from the scenes of launch_configs/scenes/.

The same scenes give the same bytes, as long as the zstd library is the same.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import shutil
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import zstandard
from expected_events import expected_events
from rich.console import Console

from stickslip_lab.scenes.scene import Scene, load_scene, write_bag
from stickslip_lab.scenes.truth_topics import has_truth, read_truth
from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Recording
from stickslip_monitor.errors import BagError, StickslipError

ROOT = Path(__file__).resolve().parents[1]
SCENES = ROOT / 'launch_configs' / 'scenes'
SCHEMA = 'stickslip_monitor/bags/1'
# Effects with which the alarms that are due follow from closed forms.
PLAIN = {
    'speed_profile',
    'load_profile',
    'sensor_noise',
    'friction_drift',
    'operating_point',
    'lining_motion',
}


def main(argv: Sequence[str] | None = None) -> int:
    """Make every bag; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--output', type=Path, default=ROOT / 'bags', help='default: bags/')
    output = parser.parse_args(argv).output
    console = Console(highlight=False, soft_wrap=True)
    output.mkdir(parents=True, exist_ok=True)
    bags = {}
    try:
        for scene in sorted(SCENES.glob('*.yaml')):
            begin = time.perf_counter()
            bags[scene.stem] = entry = make_bag(scene, output)
            console.print(
                f'{scene.stem}: {entry["messages"]} messages, {entry["bytes"]} bytes,'
                f' {len(entry["episodes"])} episodes, {time.perf_counter() - begin:.1f} s'
            )
    except StickslipError as error:
        console.print(f'ERROR: {error}', markup=False)
        return 2
    manifest = {'schema': SCHEMA, 'zstd': zstd_version(), 'bags': bags}
    text = json.dumps(manifest, indent=2, ensure_ascii=False)
    (output / 'manifest.json').write_text(text + '\n', 'utf-8')
    return 0


def make_bag(scene_path: Path, output: Path) -> dict[str, Any]:
    """Make one bag in place of the old one; return its entry in the manifest."""
    scene = load_scene(scene_path)
    with tempfile.TemporaryDirectory(dir=output, prefix='.') as folder:
        fresh = Path(folder) / scene_path.stem
        write_bag(scene, fresh)
        target = output / scene_path.stem
        _remove_bag(target)
        fresh.rename(target)
    (recording,) = target.glob('*.mcap')
    data = recording.read_bytes()
    bag = open_bag(target)
    return {
        'description': scene.description,
        'scene': scene_path.relative_to(ROOT).as_posix(),
        'seed': scene.seed,
        'file': recording.relative_to(output).as_posix(),
        'bytes': len(data),
        'sha256': hashlib.sha256(data).hexdigest(),
        'content_sha256': content_digest(target),
        'messages': bag.message_count,
        'duration': scene.duration,
        'start_ns': scene.start_ns,
        'episodes': _true_episodes(scene, bag),
        'events': _due_events(scene, bag),
    }


def _remove_bag(bag: Path) -> None:
    """Remove a recording made before, and nothing else.

    Raises:
        BagError: Something else is in its folder.
    """
    expected = {f'{bag.name}_0.mcap', 'metadata.yaml'}
    unexpected = sorted({path.name for path in bag.iterdir()} - expected) if bag.exists() else []
    if unexpected:
        raise BagError(f"'{bag}' is not replaced: it holds {unexpected[0]}, which was not made here")
    if bag.exists():
        shutil.rmtree(bag)


def _true_episodes(scene: Scene, bag: Recording) -> list[dict[str, Any]]:
    """Return the true episodes of stick-slip of every bearing, in seconds since the scene's start."""
    return [
        {
            'bearing': config.name,
            'first_stick': round((first - scene.start_ns) * 1e-9, 3),
            'last_stick': round((last - scene.start_ns) * 1e-9, 3),
        }
        for config in scene.config.bearings
        if has_truth(bag, config.name)
        for first, last in read_truth(bag, config.name).episodes
    ]


def _due_events(scene: Scene, bag: Recording) -> list[dict[str, Any]] | None:
    """Return the alarms that are due, or None where no closed form knows them, or noise decides."""
    if not {settings.name for settings in scene.effects} <= PLAIN:
        return None
    try:
        return [event.record() for event in expected_events(scene, bag)]
    except ValueError:
        return None


def content_digest(bag: Path) -> str:
    """Digest of topics, types, times and data of all messages, whatever their compression."""
    digest = hashlib.sha256()
    for message in open_bag(bag).messages():
        head = f'{message.topic}\0{message.type}\0{message.log_time_ns}\0{len(message.data)}\0'
        digest.update(head.encode())
        digest.update(message.data)
    return digest.hexdigest()


def zstd_version() -> str:
    """Version of the library that compresses the recordings."""
    return '.'.join(map(str, zstandard.ZSTD_VERSION))


if __name__ == '__main__':
    sys.exit(main())
