# SPDX-License-Identifier: Apache-2.0
"""Judges the monitor, and bare rules beside it, over simulated scenes and over bags.

One call is one scene with one seed, for as many grades of sensors as are asked for: what the ship
does, and what the lining does with it, is simulated once. Arguments and results are plain values,
so that the calls can be made in processes. A scene is judged by its recording, as any bag.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.warning_quality import Interval, Quality, RuleOutput, merge_intervals, quality_of
from stickslip_lab.scenes.scene import STAGES, Scene, load_scene, write_bag
from stickslip_lab.scenes.settings import random_stream
from stickslip_lab.scenes.truth_topics import TruthRecord, has_truth, known_truth, read_truth
from stickslip_logs.recordings.recording import Recording
from stickslip_monitor import jit
from stickslip_monitor.errors import PhysicsError, SceneError
from stickslip_monitor.monitor.alarm_causes import LASTING_NS
from stickslip_monitor.monitor.alarm_list import Action, AlarmChange, Annunciator
from stickslip_monitor.monitor.alarm_states import LATCHING, AlarmState
from stickslip_monitor.monitor.assessment import assess
from stickslip_monitor.monitor.input_faults import SourceWatch, least_gap
from stickslip_monitor.monitor.parameters import BearingConfig, MonitorConfig
from stickslip_monitor.monitor.rule import si_value
from stickslip_monitor.monitor.rule_over_arrays import BearingScan, Scan
from stickslip_monitor.monitor.rule_settings import settings_of
from stickslip_monitor.monitor.sample_types import Input, Stream
from stickslip_monitor.monitor.severity import LADDER, Condition, Severity
from stickslip_monitor.monitor.statements import Verdict
from stickslip_monitor.offline.check import RecordingBuffer, check_recording
from stickslip_monitor.offline.extremes import condition_intervals
from stickslip_monitor.offline.processes import run_in_processes

MINUTE_NS = 60 * 10**9
OURS, BELOW_FOLD, BELOW_HOPF = 'monitor', 'below_fold', 'below_hopf'


@dataclass(frozen=True, slots=True)
class Call:
    """A scene with a seed."""

    scene: str  # its file
    seed: int | None  # the seed; None: the file's
    # Files of sensors, one after the other; None: what the scene itself says.
    sensors: tuple[str | None, ...] = (None,)


@dataclass(frozen=True, slots=True)
class Voyage:
    """Quality of the warnings on one bearing on one voyage with one grade of sensors."""

    scene: str  # the scene's file, or the recording
    seed: int | None  # the seed; None: a recording
    sensors: str | None  # the file of sensors; None: what the scene itself says
    bearing: str  # name of the bearing
    rules: dict[str, Quality]  # the judgement of each rule by name


def judge_calls(calls: Sequence[Call], jobs: int) -> Generator[tuple[int, list[Voyage]], None, None]:
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
    voyages: list[Voyage] = []
    truths: dict[str, TruthRecord] = {}
    for sensors in call.sensors:
        scene = load_scene(call.scene, call.seed, sensors)
        try:
            for case in cases_of(scene, truths):
                name = case.sent.config.name
                voyages.append(Voyage(call.scene, scene.seed, sensors, name, case.rules()))
        except SceneError as error:
            raise SceneError(f'{call.scene}, seed {scene.seed}: {error}') from error
    return voyages


def cases_of(scene: Scene, truths: dict[str, TruthRecord] | None = None) -> Iterator[Sailed]:
    """Simulate a scene; yield each of its bearings, to be judged.

    Where the truth about them is known from another grade of sensors it is not followed again;
    else it is added to what is known.

    Raises:
        SceneError: It says nothing about the truth.
    """
    truths = {} if truths is None else truths
    sent = {channel.topic for channel in scene.channels}
    is_known = truths and not any(channel.quantity == 'level' for channel in scene.channels)
    configured = [
        with_parameter_errors(
            replace(bearing, level=bearing.level if bearing.level and bearing.level.topic in sent else None),
            scene.parameter_error,
            scene.seed,
        )
        for bearing in scene.config.bearings
    ]
    with TemporaryDirectory(prefix='stickslip_') as folder:
        path = Path(folder) / 'voyage.mcap'
        write_bag(_without_lining(scene) if is_known else scene, path)
        config = replace(scene.config, bearings=tuple(configured))
        buffer = _check_in_memory(path, config, jit.has_compiler())
        for bearing in configured:
            if bearing.name not in truths:
                truths[bearing.name] = _read_full_truth(buffer.bag, bearing.name)
    for bearing in configured:
        yield Sailed(SensorRecord.of(buffer, bearing), truths[bearing.name], _is_plain(scene))


def _check_in_memory(path: str | Path, config: MonitorConfig, long: bool | None = None) -> RecordingBuffer:
    """Return the samples and verdicts of a recording, in memory."""
    buffer = RecordingBuffer()
    check_recording(path, config, [buffer], long=long)
    return buffer


@dataclass(frozen=True)
class SensorRecord:
    """Samples and verdicts of a bearing over a whole recording."""

    config: BearingConfig
    stream: Stream  # its samples in order of arrival
    start_ns: int | None  # of the recording [ns]
    end_ns: int | None

    @classmethod
    def of(cls, buffer: RecordingBuffer, config: BearingConfig) -> SensorRecord:
        """Return the samples and verdicts of one bearing."""
        record = cls(config, buffer.stream(config.name), buffer.start_ns, buffer.end_ns)
        record.__dict__['scan'] = buffer.scan(config.name)  # known already
        return record

    @cached_property
    def scan(self) -> Scan:
        """The verdicts, computed at first use."""
        # Of many voyages a second of compiling is soon repaid.
        bearing_scan = BearingScan(self.config, self.start_ns, long=jit.has_compiler())
        return bearing_scan.finish(self.stream, self.end_ns)


@dataclass(frozen=True, slots=True, eq=False)
class Sailed:
    """One bearing on one voyage: what the monitor is configured with and gets, and the truth."""

    sent: SensorRecord  # the bearing as the monitor has it, and its samples
    truth: TruthRecord  # the truth
    plain: bool  # whether what happens shows in speed and load, and does so once

    def output(self) -> RuleOutput:
        """Return the episodes that the monitor gave, with its sounds and the unheard ones."""
        scan, truth = self.sent.scan, self.truth
        sounds, unheard = sounds_of(scan, truth.start_ns, truth.end_ns)
        return replace(output_of(scan, truth), sounds=sounds, unheard=unheard)

    def rules(self) -> dict[str, Quality]:
        """Judge the monitor and the bare rules."""
        outputs = {OURS: self.output(), **_bare_rules(self.sent.scan)}
        qualities = {
            name: quality_of(rule_output, self.truth, self.plain) for name, rule_output in outputs.items()
        }
        wrong_source = int(_has_wrong_source(self.sent))
        return qualities | {OURS: replace(qualities[OURS], wrong_source=wrong_source)}


def judge_bag(path: str | Path, config: MonitorConfig) -> list[tuple[Voyage, Sailed]]:
    """Judge the bearings of a bag about which it holds the truth.

    Raises:
        BagError: The bag cannot be read, or it holds no truth.
    """
    buffer = _check_in_memory(path, config)
    judged = []
    for bearing in [b for b in config.bearings if has_truth(buffer.bag, b.name)] or config.bearings[:1]:
        # A recording does not say whether all that happened in it shows in speed and load.
        case = Sailed(SensorRecord.of(buffer, bearing), read_truth(buffer.bag, bearing.name), plain=False)
        judged.append((Voyage(str(path), None, None, bearing.name, case.rules()), case))
    return judged


def _is_plain(scene: Scene) -> bool:
    """Return whether events show in speed and load, and do so once: no knocks, wear, waves."""
    return not any(
        effect.name in ('load_in_waves', 'friction_drift') or 'knocks' in effect for effect in scene.effects
    )


def _without_lining(scene: Scene) -> Scene:
    """Return the scene without the truth, which another grade of sensors does not change."""
    other_effects = tuple(effect for effect in scene.effects if effect.name not in STAGES['lining'])
    return replace(scene, effects=other_effects)


def _read_full_truth(bag: Recording, bearing: str) -> TruthRecord:
    """Return the truth about a bearing.

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
    """Return the alarms by the monitor's conditions; while an input is lost the previous state stands."""
    warned: list[Interval] = []
    alarmed: list[Interval] = []
    level = Severity.OK
    for part in condition_intervals(scan.events, truth.start_ns, truth.end_ns):
        level = level if part.condition is Condition.INPUT_STALE else part.condition.severity
        stretch = (part.start_ns, part.end_ns)
        warned += [stretch] if level >= Severity.WARN else []
        alarmed += [stretch] if level >= Severity.ERROR else []
    raised = [
        (event.time_ns, LADDER.index(event.after))
        for event in scan.events
        if event.raised and event.after is not Condition.INPUT_STALE
    ]
    return RuleOutput(merge_intervals(warned), merge_intervals(alarmed), raised, len(scan.events))


def sounds_of(scan: Scan, start_ns: int, end_ns: int) -> tuple[list[int], int]:
    """Return when alarms sound, acknowledged once a minute, and how many stretches of stick-slip are unheard.

    Begins and ends of rest, which suppresses alarms, and of stick-slip, with one point of each
    second of it, are taken from the points.
    """
    name, alarms = scan.config.name, Annunciator(MonitorConfig(bearings=(scan.config,)))
    rests, sticking = scan.speed == 0.0, scan.sticking
    seconds = np.diff(scan.time_ns // 10**9, prepend=0) != 0
    changes = np.diff(rests, prepend=False) | np.diff(sticking, prepend=False)
    rows = (changes | (sticking & seconds)).nonzero()[0]
    minutes = range(start_ns + MINUTE_NS, end_ns, MINUTE_NS)
    calls: list[tuple[int, Callable[[], list[AlarmChange]]]] = [
        *((e.time_ns, partial(alarms.take_event, e)) for e in scan.events),
        *((int(scan.time_ns[k]), partial(_take_point, alarms, scan, int(k))) for k in rows),
        *((t, partial(alarms.act, Action.ACKNOWLEDGE, t, name)) for t in minutes),
    ]
    latching = [alarms.alarms[name][kind] for kind in LATCHING]
    sound_times, unheard, is_heard = [], 0, False
    for time_ns, call in sorted(calls, key=lambda timed_call: timed_call[0]):
        changes = [*alarms.advance(time_ns - start_ns, time_ns), *call()]
        sound_times += [time_ns] * sum(change.aloud for change in changes)
        lasting = alarms.causes[name].sticking_ns
        is_acknowledged = any(alarm.state is AlarmState.ACKNOWLEDGED for alarm in latching)
        is_heard = (is_heard and lasting > 0) or alarms.sounding or is_acknowledged
        unheard += lasting >= LASTING_NS and not is_heard
        is_heard |= lasting >= LASTING_NS
    return sound_times, unheard


def _take_point(alarms: Annunciator, scan: Scan, row: int) -> list[AlarmChange]:
    speed, load = float(scan.speed[row]), float(scan.load[row])
    judge = partial(assess, scan.config.bearing, speed, load)
    sticking = bool(scan.sticking[row])
    verdict = Verdict(scan.config.name, int(scan.time_ns[row]), judge, speed, load, sticking=sticking)
    return alarms.take_verdict(verdict)


def _bare_rules(scan: Scan) -> dict[str, RuleOutput]:
    """Return the rules V < V_F and V < V_H, sample by sample, as warning and as alarm."""
    margins = {BELOW_FOLD: scan.assessment.fold_margin, BELOW_HOPF: scan.assessment.hopf_margin}
    outputs = {}
    for name, margin in margins.items():
        below = np.asarray(margin) < 0.0
        pairs = zip(scan.time_ns[below].tolist(), scan.until_ns[below].tolist(), strict=True)
        stretches = merge_intervals(pairs)
        begins = [start for start, _ in stretches]
        raised = [(begin, 0) for begin in begins]
        outputs[name] = RuleOutput(stretches, stretches, raised, 2 * len(stretches), begins)
    return outputs


def _has_wrong_source(sent: SensorRecord) -> bool:
    """Return whether the source of an input is reported to be wrong."""
    config, stream = sent.config, sent.stream
    live = settings_of(config).live
    for place in (Input.SPEED, Input.LOAD):
        is_of_place = stream.inputs == place
        si = si_value(live, place, stream.value[is_of_place])
        watch = SourceWatch(least_gap(config, place))
        if watch.take_column(stream.arrival_ns[is_of_place], si):
            return True
    return False


def with_parameter_errors(config: BearingConfig, errors: Mapping[str, float], seed: int) -> BearingConfig:
    """Return the configuration of a bearing as the monitor gets it, with errors drawn for a seed.

    Errors are given by parameter; each is drawn evenly up to it, either way.
    """
    factor = {
        name: 1.0 + error * float(random_stream(seed, 'parameter_error', config.name, name).uniform(-1, 1))
        for name, error in errors.items()
    }
    law: Any = config.bearing.friction  # a dataclass, as every law
    try:
        law_changes = _scale_attributes(law, 'friction.', factor)
        friction = replace(law, **law_changes) if law_changes else law
        bearing = replace(config.bearing, friction=friction, **_scale_attributes(config.bearing, '', factor))
    except PhysicsError as error:
        raise SceneError(f'parameter_error of bearing {config.name}: {error}') from error
    return replace(
        config,
        bearing=bearing,
        speed=replace(config.speed, **_scale_attributes(config.speed, 'speed.', factor)),
        load=replace(config.load, **_scale_attributes(config.load, 'load.', factor)),
    )


def _scale_attributes(target: Any, prefix: str, factor: Mapping[str, float]) -> dict[str, Any]:
    """Return the attributes of a target that are off, e.g. ``static`` for ``friction.static``."""
    names = {n: n.removeprefix(prefix) for n in factor if n.startswith(prefix)}
    names_here = {n: name for n, name in names.items() if '.' not in name}
    field_names = [f.name for f in fields(target)]
    for n, name in names_here.items():
        if name not in field_names:
            kind = type(target).__name__.lower()
            raise PhysicsError(f'{n}: a {kind} law has no {name}')
    return {name: getattr(target, name) * factor[n] for n, name in names_here.items()}
