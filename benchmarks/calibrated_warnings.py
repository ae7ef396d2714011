# SPDX-License-Identifier: Apache-2.0
"""Warnings with parameters as configured, after a calibration, and with the true ones.

The voyages of warning quality are sailed with ordinary sensors, each seed with its own bearing and
its own errors of the parameters, and the monitor is judged by the truth. The calibration of a seed
is that of five slow-downs of other seeds with a level, through the same errors.
``python -m benchmarks.calibration_study warnings`` writes the table.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.voyages import cases_of, output_of, with_parameter_errors
from benchmarks.warning_quality import Quality, pool_qualities, quality_of
from stickslip_lab.calibration.calibration import Calibration, EvidenceSource
from stickslip_lab.scenes.scene import load_scene, write_bag
from stickslip_monitor.errors import CalibrationError
from stickslip_monitor.monitor.parameters import BearingConfig, MonitorConfig
from stickslip_monitor.offline.check import RecordingBuffer, check_recording
from stickslip_monitor.physics.probability import Belief, Tolerance

ROOT = Path(__file__).resolve().parents[1]
SCENES = ROOT / 'launch_configs' / 'scenes' / 'quality'
ORDINARY, WITH_LEVEL = (ROOT / f'launch_configs/sensors/{n}.yaml' for n in ('ordinary', 'ordinary_level'))
# A wrong source tells nothing of a calibration.
VOYAGES = [path for path in sorted(SCENES.glob('*.yaml')) if path.stem != 'two_publishers']
# Seeds of slow-downs are so far from those of the voyages: the same bearing, other courses.
_APART, _SLOW_DOWNS = 1000, 5
SEEDS = range(401, 413)
"""Seeds that no constant was chosen on."""
HANDBOOK = Tolerance(damping=0.40, static=0.15, kinetic=0.15, decay=0.30)
VARIANTS = {
    'configured': 'as configured',
    'handbook': 'the same, `tolerance` of a handbook',
    'calibrated': 'calibrated by five slow-downs',
    'true': 'true parameters',
}
COLUMNS = {
    'false_per_100h': 'false in 100 h',
    'wrong_hours': 'hours wrongly in alarm',
    'lead_10s': 'lead of 10 s',
    'told': 'within 5 s',
}
"""What is shown of a variant, as in :data:`benchmarks.warning_quality.FIGURES`."""


def calibration_of(seed: int) -> Calibration | None:
    """Calibrate a seed's bearing by five slow-downs with a level; return ``None`` where they are refused."""
    evidence, source = [], EvidenceSource()
    for k in range(1, _SLOW_DOWNS + 1):
        scene = load_scene(SCENES / 'slowing_down.yaml', seed + k * _APART, WITH_LEVEL)
        bearing = with_parameter_errors(scene.config.bearings[0], scene.parameter_error, seed)
        with TemporaryDirectory(prefix='stickslip_') as folder:
            path, buffer = Path(folder) / f'slow_down_{k}.mcap', RecordingBuffer()
            write_bag(scene, path)
            check_recording(path, MonitorConfig((bearing,)), [buffer])
            evidence.append(source.of_recording(buffer, bearing))
    try:
        return source.calibrated(bearing, evidence)
    except CalibrationError:
        return None


def variants_of(config: BearingConfig, true: BearingConfig, seed: int) -> dict[str, BearingConfig]:
    """Return the configurations that are judged, by name; a refused calibration changes nothing."""
    belief = Belief.from_tolerance(config.bearing, HANDBOOK)
    calibration, calibrated = calibration_of(seed), config
    if calibration is not None:
        calibrated_belief = replace(
            calibration.belief, speed=math.hypot(calibration.floor, config.tolerance.speed)
        )
        calibrated = replace(config, bearing=calibration.bearing, belief=calibrated_belief)
    handbook = replace(config, tolerance=HANDBOOK, belief=belief)
    return dict(zip(VARIANTS, (config, handbook, calibrated, true), strict=True))


def judge_variants(seed: int) -> dict[str, Quality]:
    """Judge each variant over all voyages of a seed."""
    by_variant: dict[str, list[Quality]] = {name: [] for name in VARIANTS}
    configs: Mapping[str, BearingConfig] = {}
    for voyage in VOYAGES:
        scene = load_scene(voyage, seed, ORDINARY)
        for case in cases_of(scene):
            configs = configs or variants_of(case.sent.config, scene.config.bearings[0], seed)
            for name, config in configs.items():
                sent = replace(case.sent, config=replace(config, level=None))
                output = output_of(sent.scan, case.truth)
                by_variant[name].append(quality_of(output, case.truth, case.plain))
    return {name: pool_qualities(qualities) for name, qualities in by_variant.items()}


def judge_all_variants(seeds: Iterable[int]) -> dict[str, Quality]:
    """Judge each variant over all voyages of some seeds."""
    by_seed = [judge_variants(seed) for seed in seeds]
    return {name: pool_qualities(qualities[name] for qualities in by_seed) for name in VARIANTS}
