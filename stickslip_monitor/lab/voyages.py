# SPDX-License-Identifier: Apache-2.0
"""Judges the monitor, and bare rules beside it, over simulated scenes and over bags.

One call is one scene with one seed, for as many grades of sensors as are asked for: what the ship
does, and what the lining does with it, is simulated once. Arguments and results are plain values,
so that the calls can be made in processes. A scene is judged by its recording, as any bag.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from stickslip_monitor import jit
from stickslip_monitor.arrays import IntArray
from stickslip_monitor.bags.reader import Bag
from stickslip_monitor.errors import SceneError
from stickslip_monitor.lab.scenes.recording import write_bag
from stickslip_monitor.lab.scenes.scene import STAGES, Scene, load_scene
from stickslip_monitor.lab.scenes.settings import with_parameter_errors
from stickslip_monitor.lab.truth import (
    TruthRecord,
    has_truth,
    known_truth,
    on_recorder_clock,
    read_truth,
    scan_on_recorder_clock,
)
from stickslip_monitor.lab.warning_quality import (
    Interval,
    Quality,
    RuleOutput,
    merged,
    quality_of,
)
from stickslip_monitor.monitor.bulk import BearingScan, Scan
from stickslip_monitor.monitor.config import BearingConfig, MonitorConfig
from stickslip_monitor.monitor.ladder import LADDER, Condition, Level
from stickslip_monitor.monitor.signals import Stream, to_si
from stickslip_monitor.monitor.source_faults import SourceWatch, least_gap
from stickslip_monitor.offline.check import scan_whole
from stickslip_monitor.offline.fleet import run_in_processes
from stickslip_monitor.offline.outline import condition_intervals

Alarm = Mapping[str, Any]
OURS, BELOW_FOLD, BELOW_HOPF = 'monitor', 'below_fold', 'below_hopf'


@dataclass(frozen=True, slots=True)
class Call:
    """A scene with a seed."""

    scene: str  # its file
    seed: int | None  # the seed; None: the file's
    # Files of sensors, one after the other; None: what the scene itself says.
    sensors: tuple[str | None, ...] = (None,)
    # Fields of the alarm's configuration that are changed: each is judged as well.
    variants: tuple[Alarm, ...] = ()
    varied_sensors: str | None = None  # the file of sensors with which the variants are judged


@dataclass(frozen=True, slots=True)
class Voyage:
    """What came of one bearing on one voyage with one grade of sensors."""

    scene: str  # the scene's file, or the recording
    seed: int | None  # the seed; None: a recording
    sensors: str | None  # the file of sensors; None: what the scene itself says
    bearing: str  # name of the bearing
    rules: dict[str, Quality]  # the judgement of each rule by name
    variants: tuple[Quality, ...] = ()  # that of the monitor with each of the call's variants


def judge_calls(
    calls: Sequence[Call], jobs: int
) -> Generator[tuple[int, list[Voyage]], None, None]:
    """Judge calls in processes, or one after the other in this one if ``jobs`` is 1.

    Yields:
        The number of each call, as it is done, and what :func:`judge` made of it.

    Raises:
        SceneError: A scene breaks a rule, or its process died; the text names it.
    """
    if jobs == 1:
        yield from ((number, judge(call)) for number, call in enumerate(calls))
        return
    by_number = {number: (call,) for number, call in enumerate(calls)}
    for number, outcome in run_in_processes(judge, by_number, jobs):
        if isinstance(outcome, BrokenProcessPool):
            scene = calls[number].scene
            raise SceneError(f'{scene}: its process died (was there enough memory?)')
        if isinstance(outcome, BaseException):
            raise outcome
        yield number, outcome


def judge(call: Call) -> list[Voyage]:
    """Simulate a scene with a seed, and judge its bearings with each grade of sensors.

    Raises:
        SceneError: The scene breaks a rule, or says nothing about the truth.
    """
    found: list[Voyage] = []
    truths: dict[str, TruthRecord] = {}
    for sensors in call.sensors:
        scene = load_scene(call.scene, call.seed, sensors)
        variants = call.variants if sensors == call.varied_sensors else ()
        try:
            for case in cases_of(scene, truths):
                rules, varied = case.rules(), tuple(map(case.varied, variants))
                name = case.config.name
                found.append(Voyage(call.scene, scene.seed, sensors, name, rules, varied))
        except SceneError as error:
            raise SceneError(f'{call.scene}, seed {scene.seed}: {error}') from error
    return found


def cases_of(scene: Scene, truths: dict[str, TruthRecord] | None = None) -> Iterator[Sailed]:
    """Simulate a scene; each of its bearings, to be judged.

    Where the truth about them is known from another grade of sensors it is not followed again;
    else it is added to what is known.

    Raises:
        SceneError: It says nothing about the truth.
    """
    truths = {} if truths is None else truths
    sent = {channel.topic for channel in scene.channels}
    known = truths and not any(channel.quantity == 'level' for channel in scene.channels)
    configured = [
        with_parameter_errors(
            replace(own, level=own.level if own.level and own.level.topic in sent else None),
            scene.parameter_error,
            scene.seed,
        )
        for own in scene.config.bearings
    ]
    with TemporaryDirectory(prefix='stickslip_') as folder:
        path = Path(folder) / 'voyage.mcap'
        write_bag(_without_lining(scene) if known else scene, path)
        whole = scan_whole(path, replace(scene.config, bearings=tuple(configured)))
        for own in configured:
            if own.name not in truths:
                truths[own.name] = _truth(whole.bag, own.name)
    for own in configured:
        found = whole.bearings[own.name]
        truth = truths[own.name]
        yield Sailed(own, found.stream, found.arrival_ns, truth, _is_plain(scene))


@dataclass(frozen=True, slots=True, eq=False)
class Sailed:
    """One bearing on one voyage: what the monitor is configured with and gets, and the truth."""

    config: BearingConfig  # as the monitor has it
    stream: Stream  # the samples
    arrival_ns: IntArray  # when the recorder got each [ns]
    truth: TruthRecord  # the truth
    plain: bool  # whether what happens shows in speed and load, and does so once

    def rules(self, recorded: Scan | None = None) -> dict[str, Quality]:
        """The judgement of the monitor, by its verdicts where they are known, and bare rules."""
        recorded = self.recorded() if recorded is None else recorded
        ours = self._judged(output_of(recorded, self.truth))
        wrong_source = _has_wrong_source(self.config, self.stream, self.arrival_ns)
        bare = {name: self._judged(output) for name, output in _bare_rules(recorded).items()}
        return {OURS: replace(ours, wrong_source=int(wrong_source)), **bare}

    def varied(self, variant: Alarm) -> Quality:
        """The judgement of the monitor with some fields of its alarm changed."""
        config = replace(self.config, alarm=replace(self.config.alarm, **variant))
        return self._judged(output_of(self._scan(config), self.truth))

    def recorded(self) -> Scan:
        """The verdicts, on the recorder's clock."""
        return on_recorder_clock(self.stream, self.arrival_ns, self._scan(self.config))

    def _scan(self, config: BearingConfig) -> Scan:
        """Between begin and end on the clock of the samples, as a check of a recording does."""
        span, time = (self.truth.start_ns, self.truth.end_ns), self.stream.time_ns
        if time.size and (time[0] < span[0] or time.max() > span[1]):
            span = int(time[0]), int(time.max())
        # Of many voyages a second of compiling is soon repaid.
        return BearingScan(config, span[0], jit.has_compiler()).finish(self.stream, span[1])

    def _judged(self, output: RuleOutput) -> Quality:
        return quality_of(output, self.truth, self.plain)


@dataclass(frozen=True, slots=True, eq=False)
class JudgedBag:
    """One bearing in one bag."""

    voyage: Voyage  # the judgement
    config: BearingConfig  # the bearing
    scan: Scan  # the verdicts, on the recorder's clock
    output: RuleOutput  # what they come to
    truth: TruthRecord  # what they are judged by


def judge_bag(path: str | Path, config: MonitorConfig) -> list[JudgedBag]:
    """Judge the bearings of a bag about which it holds the truth.

    Raises:
        BagError: The bag cannot be read, or it holds no truth.
    """
    whole = scan_whole(path, config)
    found = []
    for own in [b for b in config.bearings if has_truth(whole.bag, b.name)] or config.bearings[:1]:
        truth = read_truth(whole.bag, own.name)
        scan, sent = scan_on_recorder_clock(whole, own), whole.bearings[own.name]
        # A recording does not say whether all that happened in it shows in speed and load.
        rules = Sailed(own, sent.stream, sent.arrival_ns, truth, plain=False).rules(scan)
        voyage = Voyage(str(path), None, None, own.name, rules)
        found.append(JudgedBag(voyage, own, scan, output_of(scan, truth), truth))
    return found


def _is_plain(scene: Scene) -> bool:
    """Whether what happens shows in speed and load, and does so once: no knocks, wear, waves."""
    return not any(
        effect.name in ('load_in_waves', 'friction_drift') or 'knocks' in effect
        for effect in scene.effects
    )


def _without_lining(scene: Scene) -> Scene:
    """The scene without the truth, which another grade of sensors does not change."""
    kept = tuple(effect for effect in scene.effects if effect.name not in STAGES['lining'])
    return replace(scene, effects=kept)


def _truth(bag: Bag, bearing: str) -> TruthRecord:
    """The truth about a bearing.

    Raises:
        SceneError: The scene does not hold it.
    """
    truth = known_truth(bag, bearing)
    fold = truth.fold_margin.value
    if not fold.size:
        raise SceneError('without the effect operating_point the true margins are unknown')
    if not has_truth(bag, bearing) and fold.min() < 0.0:
        raise SceneError(
            'without the effect lining_motion it is unknown whether the lining sticks, and the'
            f' fold margin falls to {fold.min():.3g}'
        )
    return truth


def output_of(scan: Scan, truth: TruthRecord) -> RuleOutput:
    """What the monitor's conditions say; while an input is lost what stood before it goes on."""
    warned: list[Interval] = []
    alarmed: list[Interval] = []
    level = Level.OK
    for part in condition_intervals(scan.events, truth.start_ns, truth.end_ns):
        level = level if part.condition is Condition.INPUT_STALE else part.condition.level
        stretch = (part.start_ns, part.end_ns)
        warned += [stretch] if level >= Level.WARN else []
        alarmed += [stretch] if level >= Level.ERROR else []
    raised = [
        (event.time_ns, LADDER.index(event.after))
        for event in scan.events
        if event.raised and event.after is not Condition.INPUT_STALE
    ]
    return RuleOutput(merged(warned), merged(alarmed), raised, len(scan.events))


def _bare_rules(scan: Scan) -> dict[str, RuleOutput]:
    """The rules V < V_F and V < V_H, sample by sample, as warning and as alarm."""
    margins = {BELOW_FOLD: scan.assessment.fold_margin, BELOW_HOPF: scan.assessment.hopf_margin}
    found = {}
    for name, margin in margins.items():
        below = np.asarray(margin) < 0.0
        pairs = zip(scan.time_ns[below].tolist(), scan.until_ns[below].tolist(), strict=True)
        stretches = merged(pairs)
        raised = [(start, 0) for start, _ in stretches]
        found[name] = RuleOutput(stretches, stretches, raised, 2 * len(stretches))
    return found


def _has_wrong_source(config: BearingConfig, stream: Stream, arrival_ns: IntArray) -> bool:
    """Whether the source of an input is reported as wrong."""
    for place, source in enumerate((config.speed, config.load)):
        own = stream.inputs == place
        si = to_si(source, stream.value[own])
        gap = least_gap(config, place)
        if SourceWatch(gap).see_many(arrival_ns[own], stream.time_ns[own], si):
            return True
    return False
