# SPDX-License-Identifier: Apache-2.0
"""A scene: what happens to one ship's shaft, and what its sensors send."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from stickslip_monitor.lab.scenes.cost import Stopwatch
from stickslip_monitor.lab.scenes.effects.effect import BuildContext
from stickslip_monitor.lab.scenes.effects.registry import SceneRun, build_run
from stickslip_monitor.lab.scenes.settings import Settings
from stickslip_monitor.lab.scenes.shaft import Shaft
from stickslip_monitor.lab.scenes.telemetry import Channel
from stickslip_monitor.monitor.config import MonitorConfig


@dataclass(frozen=True, slots=True)
class Scene:
    """A validated scene.

    Attributes:
        description: What it shows.
        duration: Its duration, > 0 [s].
        start_ns: Time stamp of its start [ns since 1970].
        seed: Seed of all random streams.
        folder: Folder of the scene file.
        config_path: File of the configuration.
        config: The configuration of the bearings.
        channels: The channels of telemetry.
        effects: The settings of each effect, in the order in which they act.
        parameter_error: By parameter the largest relative error of what the monitor is told.
    """

    description: str
    duration: float
    start_ns: int
    seed: int
    folder: Path
    config_path: Path
    config: MonitorConfig
    channels: tuple[Channel, ...]
    effects: tuple[Settings, ...]
    parameter_error: Mapping[str, float] = field(default_factory=dict)

    def build(self, stopwatch: Stopwatch | None = None) -> SceneRun:
        """Build one run of the scene.

        Args:
            stopwatch: Times its effects, if given.

        Raises:
            SceneError: A setting breaks its rule.
        """
        frame = BuildContext(
            self.duration,
            self.seed,
            self.channels,
            Shaft(self.channels),
            self.folder,
            self.start_ns,
            stopwatch=stopwatch,
        )
        return build_run(self.effects, frame)

    @property
    def message_count(self) -> int:
        """Samples on all channels."""
        return sum(channel.count(self.duration) for channel in self.channels)
