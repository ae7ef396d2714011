# SPDX-License-Identifier: Apache-2.0
"""Watches the inputs: how fast samples come, and what is wrong with them, one sentence for each fault.

The facts are gathered by whoever has them: :class:`InputWatch` once a second beside a running
monitor, a check from a recording. Neither knows ROS: who publishes is asked of a :class:`Graph`.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from stickslip_logs.field_paths import ByName
from stickslip_logs.units import SECOND_NS
from stickslip_monitor.arrays import FloatArray, IndexArray, IntArray
from stickslip_monitor.monitor.bearing_monitor import BearingMonitor
from stickslip_monitor.monitor.input_fitness import FitnessWatch
from stickslip_monitor.monitor.parameters import BearingConfig, InputConfig
from stickslip_monitor.monitor.rule import NEAR, si_value
from stickslip_monitor.monitor.sample_types import INPUTS, LEVEL, QUANTITIES, STATUS_SENTENCES, Status
from stickslip_monitor.monitor.severity import Unknown, WordEnum
from stickslip_monitor.monitor.statements import age_text

ENOUGH = 12
"""Returns that raise the fault."""
LEAST_NS = 3 * SECOND_NS
"""Least time between the first of them and the fault [ns]."""
HOLD_NS = 60 * SECOND_NS
"""Time without one after which the fault is cleared [ns]."""
_GAP = 0.2
_TOLERANCE = 0.125
_PENALTY = 2
_LEAST_RPM = 3.0
MIXED = 0.2
"""From this share of the values on the rarer level makes every verdict doubtful; the medians of three
values leave out what is rarer: a spike in 137, 2 % of signs, a zero of 2 s a minute."""
STILL_MIXED = 0.1
"""Down to this share a mix that was found goes on: of one value in four some runs have less than a fifth."""
_RUNS = 6
"""The share is that of about so many runs on each level."""


class SourceFaultKind(WordEnum):
    """Kinds of fault of an input's source."""

    sentence: str

    TWO_LEVELS = (
        'two_levels',
        'values jump between two levels: two publishers on one topic, or a loose contact',
    )
    FEW_PULSES = (
        'few_pulses',
        'values jump between 0 and one level: a counter of few pulses a turn, or a loose contact;'
        ' the speed is in between',
    )


@dataclass(frozen=True, slots=True)
class SourceFault:
    """A fault of an input's source, by the arrivals of samples."""

    kind: SourceFaultKind
    since_ns: int  # of the first sample that showed it
    raised_ns: int  # of that with which there was enough evidence
    levels: tuple[float, float]  # the two, rising, SI
    share: float = 0.5  # of the values that are on the rarer of them
    is_mixed: bool = True  # whether the rarer level is so frequent that no verdict can be relied on

    def with_share(self, share: float) -> SourceFault:
        """Return the fault with a later share, and ``is_mixed`` by it: a mix ends below a smaller share."""
        return replace(self, share=share, is_mixed=share >= (STILL_MIXED if self.is_mixed else MIXED))


def least_gap(config: BearingConfig, place: int) -> float:
    """Return the least distance of two levels of an input that is no sensor's resolution [SI].

    It is 0 but for a speed: a pulse counter at dead slow toggles between two neighbouring numbers, and three
    revolutions a minute are beyond that. ``place`` is the index of the input.
    """
    return 0.0 if place else _LEAST_RPM * float(config.bearing.speed.factor('rpm'))


def fault_text(fault: SourceFault, config: InputConfig) -> str:
    """Return the fault as a clause, with its levels in the unit of the input."""
    low, high = (level / config.factor for level in fault.levels)
    return f'{fault.kind.sentence} (here {low:.4g} and {high:.4g} {config.unit})'


@dataclass(slots=True)
class SourceWatch:
    """Finds from an input's values that they come from a wrong source, or from two at once.

    Values that jump between two levels and back come from two publishers on one topic, a loose
    contact, or a counter of few pulses a turn.

    A *jump* is a step between two successive values by at least a fifth of the larger one. It *returns* if it
    ends within an eighth of its height from where the previous jump began. Each return counts one, each other
    jump takes two away; twelve raise the fault, at the earliest three seconds after the first. White noise of
    a fifth of the load reaches that less than once in a thousand hours at 10 Hz; a steady second publisher,
    with a tenth of the other's rate too, within a few seconds. A minute without evidence clears.
    Of a speed, which has a least gap, the magnitude is watched, by which the rule goes.

    Args:
        least_gap: The least distance between two levels [SI], see :func:`least_gap`.
    """

    least_gap: float = 0.0
    _count: int = 0
    _since_ns: int = 0
    _last_ns: int = 0
    _value: float = math.nan
    _origin: float = math.nan
    _fault: SourceFault | None = None
    _run: int = 0  # values since the latest jump
    _here: float = 0.0  # mean length of the runs on the present level
    _there: float = 0.0  # the same on the other one
    _other: float = math.nan  # the latest value on the other one
    _is_exchange: bool = True  # whether the latest jump was from one of the two to the other

    def take(self, arrival_ns: int, si: float) -> SourceFault | None:
        """Take one value [SI] and its arrival [ns], which must not fall; return the fault that it raises.

        ``None`` where it raises none, also while one stands. A value that is not finite is skipped.
        """
        if not math.isfinite(si):
            return None
        si = abs(si) if self.least_gap > 0.0 else si
        before, self._value, run = self._value, si, self._run
        self._run += 1
        height = abs(si - before)
        if not (height > 0.0 and height >= max(_GAP * max(abs(si), abs(before)), self.least_gap)):
            return None
        origin, self._origin = self._origin, before
        returns = abs(si - origin) <= _TOLERANCE * height
        late = self._count > 0 and arrival_ns - self._last_ns > HOLD_NS
        self._weaken_evidence(self._count if late else 0 if returns else _PENALTY)
        self._take_run(run, (before, si), returns=returns)
        return self._count_evidence(arrival_ns, (min(before, si), max(before, si))) if returns else None

    def take_column(self, arrival_ns: IntArray, si: FloatArray) -> list[SourceFault]:
        """Take values of shape (n,) as :meth:`take` does, quickly; return the faults that they raise."""
        is_finite = np.isfinite(si)
        if not is_finite.all():
            arrival_ns, si = arrival_ns[is_finite], si[is_finite]
        values = np.append(self._value, np.abs(si) if self.least_gap > 0.0 else si)
        faults, done = [], 0
        for k in _find_jumps(values).tolist():
            self._value = float(values[k])
            self._run += k - done
            faults.append(self.take(int(arrival_ns[k]), float(values[k + 1])))
            done = k + 1
        self._value = float(values[-1])
        self._run += si.size - done
        return [fault for fault in faults if fault is not None]

    def take_steady(self, si: FloatArray) -> bool:
        """Take finite values of shape (n,) if none of them can be a jump and there is no evidence yet.

        Returns:
            Whether they were taken; otherwise nothing has changed.
        """
        si = np.abs(si) if self.least_gap > 0.0 else si
        if self._count or _find_jumps(np.append(self._value, si)).size:
            return False
        self._run += si.size
        self._value = float(si[-1]) if si.size else self._value
        return True

    def standing_fault(self, now_ns: int) -> SourceFault | None:
        """Return the fault that stands, else ``None``; clear it first if a minute passed without evidence.

        ``now_ns`` is on the clock of the arrivals that :meth:`take` takes.
        """
        if now_ns - self._last_ns > HOLD_NS:
            self._weaken_evidence(self._count)
        return self._fault

    def _take_run(self, run: int, jump: tuple[float, float], *, returns: bool) -> None:
        """Take the length of the run that a jump has ended; begin one on the level that it leads to.

        A jump to the other level exchanges their means; any other is a step of the present level, which keeps
        its mean. A return undoes the jump before it. The fault that stands, if any, gets the new share.

        Args:
            run: Values since the jump before.
            jump: The values before and after the jump [SI].
            returns: Whether the jump is a return: then the run adds to its level's mean.
        """
        before, si = jump
        if not self._count:
            self._here = self._there = 0.0
        if not returns:
            is_near = abs(si - self._other) <= _TOLERANCE * abs(si - before)
            self._is_exchange = not self._count or is_near
        elif self._is_exchange and self._count:  # the first run is of unknown length
            self._here += (run - self._here) / _RUNS if self._here else run
        if self._is_exchange:
            self._here, self._there = self._there, self._here
        if self._is_exchange or returns:
            self._other = before
        self._run = 1
        if self._fault is not None:
            self._fault = self._fault.with_share(self._rarer_share())

    def _rarer_share(self) -> float:
        """Return the share of the values that are on the rarer level; 0 before any run counts."""
        total = self._here + self._there
        return min(self._here, self._there) / total if total else 0.0

    def _weaken_evidence(self, by: int) -> None:
        """Take some returns off the count; at 0 the fault is cleared."""
        self._count = max(0, self._count - by)
        if not self._count:
            self._fault = None

    def _count_evidence(self, now_ns: int, levels: tuple[float, float]) -> SourceFault | None:
        """Count a return between two levels [SI] at a time [ns].

        Returns:
            The fault, which then stands, if this return raises it; ``None`` otherwise, also while one stands.
        """
        if not self._count:
            self._since_ns = now_ns
        self._count, self._last_ns = min(self._count + 1, 2 * ENOUGH), now_ns
        if self._fault or self._count < ENOUGH or now_ns - self._since_ns < LEAST_NS:
            return None
        # Only a speed has a least distance: a load may well come and go.
        pulses = self.least_gap > 0.0 and 0.0 in levels
        kind = SourceFaultKind.FEW_PULSES if pulses else SourceFaultKind.TWO_LEVELS
        share = self._rarer_share()
        self._fault = SourceFault(kind, self._since_ns, now_ns, levels, share, share >= MIXED)
        return self._fault


def _find_jumps(values: FloatArray) -> IndexArray:
    """Return the indices before the steps between values, shape (n,), that can be jumps; n > 0.

    A first value of ``nan`` is none.
    """
    # Beside a nan, which only a first value is, half as fast functions find the ends of the others.
    low, high = values[1:].min(initial=values[0]), values[1:].max(initial=values[0])
    if math.isnan(values[0]):
        low, high = np.fmin.reduce(values), np.fmax.reduce(values)
    with np.errstate(over='ignore'):
        # As a rule the span of all is less than the least jump.
        if high - low < _GAP * min(abs(low), abs(high)):
            return np.empty(0, np.intp)
        height = np.abs(np.diff(values))
        return np.flatnonzero((height > 0.0) & (height >= _GAP * np.abs(values[1:])))


def mixed_sentence(config: BearingConfig, standing: Iterable[SourceFault | None]) -> str:
    """Return the sentence on a speed or load that is a mix of two levels; '' where neither is.

    ``standing`` are the faults of the sources of speed and load, in this order; the first mix is named.
    """
    for quantity, fault in zip(QUANTITIES, standing, strict=False):
        if fault is not None and fault.is_mixed:
            return f'On {config.inputs[quantity].topic}, {fault_text(fault, config.inputs[quantity])}.'
    return ''


MOSTLY = 1.0 / 3.0
"""From this share of refused samples on they are a fault."""
PATIENCE = 3
"""A fault is reported when so many checks in a row have found the same cause: discovery takes its time."""
SHARE_SAMPLES, SHARE_NS = 20, 10 * SECOND_NS
"""The share of refused samples is that of at least so many, over at least such a time [ns]."""
_NAMES_SHOWN = 8
"""Of the names that a message has in place of ours: more help nobody to find the slip."""
_GRAPH_PERIOD = 5
"""Checks between two questions to the graph, which costs as much as all else."""
_RATE_LOOKS = 10
"""Checks over which the rate of an input is counted."""
_BATCH = 256
"""Values of an input that are judged at once: numpy costs as much for one."""
_JUDGED = range(LEVEL + 1)  # the inputs that :mod:`.input_fitness` judges
_NUMBERS = re.compile(r'[\d.]+')


@dataclass(frozen=True, slots=True)
class Publisher:
    """Publisher on an input's topic."""

    node: str  # full name
    type: str
    qos_fault: str = ''  # why its quality of service does not match
    latched: bool = False  # it keeps its last value for those who come later, as we do not ask
    sends: bool = True  # something has come from it since the newest publisher began to send


@dataclass(frozen=True, slots=True)
class InputFacts:
    """State of one input of one bearing."""

    topic: str  # as resolved
    type: str  # the message type that is configured
    lost: bool  # it counts as lost, or has not come yet
    publishers: Sequence[Publisher] | None = ()  # None where nobody can know
    receiving: bool = False  # valid samples come
    refused: Status | None = None  # why the latest were; None where some were valid
    share: float = 0.0  # of the samples of the last while that were refused
    reason: Status | None = None  # why most of these were
    without_clock: bool = False  # time follows /clock, which is silent so far
    behind: float = 0.0  # how far its stamps are behind their arrival [s]
    stuck: bool = False  # its value has not changed for minutes, which only a level may not
    source: str = ''  # what its samples show of their source, see :class:`SourceWatch`
    unfit: str = ''  # why it cannot show stick-slip in time, see :mod:`.input_fitness`
    quantity: str = ''  # what it measures
    undecodable: bool = False  # its latest message could not be decoded
    gone: str = ''  # who published on the topic before and does no longer
    element: str = ''  # what messages for it have to name
    other_names: Sequence[str] = ()  # what those name that are for others


def input_fault(facts: InputFacts) -> str:
    """Return the sentence on the most fundamental fault of an input; '' where there is none."""
    topic = facts.topic
    if facts.without_clock:
        return 'use_sim_time is set, but nothing comes on /clock: no input can be used.'
    if (facts.lost or facts.undecodable) and (fault := _sender_fault(facts)):
        return fault
    if facts.share >= MOSTLY and facts.reason is not None:
        return (
            f'{facts.share:.0%} of the samples on {topic} are refused, most because:'
            f' {STATUS_SENTENCES[facts.reason]}.'
        )
    if facts.lost and not facts.receiving:
        return _silence_text(facts)
    if facts.stuck:
        return f'The level on {topic} never changes: its sensor is stuck.'
    if fault := _mixed_fault(facts):
        return fault
    if facts.source:
        return f'On {topic}, {facts.source}.'
    if facts.unfit:
        return f'The {facts.quantity} on {topic} {facts.unfit}.'
    return _stamp_fault(facts) if facts.receiving else ''


def _mixed_fault(facts: InputFacts) -> str:
    """Return the fault that several usable publishers send on the topic of an input; '' without it."""
    usable = [
        one for one in facts.publishers or () if one.type == facts.type and not one.qos_fault and one.sends
    ]
    if len(usable) < 2:
        return ''
    names = ', '.join(sorted({publisher.node for publisher in usable}))
    return f'{len(usable)} publishers send on {facts.topic} ({names}): their values are mixed.'


def _stamp_fault(facts: InputFacts) -> str:
    """Return the fault that stamps are far from their arrival; '' if they are near."""
    if abs(facts.behind) <= NEAR * 1e-9:
        return ''
    way = 'behind' if facts.behind > 0.0 else 'ahead of'
    return (
        f'Stamps on {facts.topic} are {age_text(abs(facts.behind))} {way} their arrival, which counts in'
        ' their place: late messages, or another clock.'
    )


def _sender_fault(facts: InputFacts) -> str:
    """Return the reason why the topic's publishers cannot give a valid value, else an empty text."""
    if facts.undecodable:
        return (
            f'Messages on {facts.topic} cannot be decoded: its sender has another definition of {facts.type}.'
        )
    if facts.publishers is not None and (fault := _connection_fault(facts, facts.publishers)):
        return fault
    if facts.refused is None:
        return ''
    return f'Every sample on {facts.topic} is refused: {STATUS_SENTENCES[facts.refused]}.'


def _connection_fault(facts: InputFacts, publishers: Sequence[Publisher]) -> str:
    """Return the reason why no publisher on the topic is connected, else an empty text."""
    topic = facts.topic
    if not publishers:
        gone = f': {facts.gone}, which published on it, has gone' if facts.gone else ''
        return f'No publisher on {topic}{gone}.'
    right = [publisher for publisher in publishers if publisher.type == facts.type]
    if not right:
        wrong = publishers[0]
        return f'{wrong.node} publishes {wrong.type} on {topic}, but {facts.type} is configured.'
    if all(publisher.qos_fault for publisher in right):
        return f'The quality of service of {right[0].node} on {topic} does not match: {right[0].qos_fault}.'
    return ''


def _silence_text(facts: InputFacts) -> str:
    """Return the sentence on an input without messages, whose publishers, if any, match."""
    topic, publishers = facts.topic, facts.publishers
    if not publishers:
        return f'No messages on {topic}.'
    if facts.element and facts.other_names and facts.element not in facts.other_names:
        names = ', '.join(facts.other_names[:_NAMES_SHOWN])
        return f"No message on {topic} names '{facts.element}': they name {names}."
    text = f'{publishers[0].node} publishes on {topic}, but nothing arrives'
    if not any(publisher.latched for publisher in publishers):
        return f'{text}.'
    return (
        f'{text}: a value that was published once is kept for those who ask for durability'
        ' transient_local and reliability reliable (qos_overrides).'
    )


class Graph:
    """Publishers of each topic; this one knows none, as beside a ship's buses."""

    def publishers(self, topic: str, bearing: str, place: int) -> Sequence[Publisher] | None:
        """Return the publishers on a topic of that full name for an input; ``None`` where unknown."""
        del topic, bearing, place
        return None

    def other_names(self, topic: str) -> Sequence[str]:
        """Return the elements of messages on a topic of that full name that are for no input."""
        del topic
        return ()

    def is_undecodable(self, topic: str) -> bool:
        """Return whether the latest message on a topic of that full name could not be decoded."""
        del topic
        return False


@dataclass(frozen=True, slots=True)
class InputState:
    """An input as it is now."""

    age: float = math.inf  # since the last valid sample came [s]
    rate: float = math.nan  # valid samples lately [Hz]; nan while unknown
    fault: str = ''  # what is wrong with it


@dataclass(slots=True)
class _Track:
    """One input as it was at the checks before; times of the steady clock [ns]."""

    source: SourceWatch
    arrived_ns: int | None = None
    behind_ns: int = 0  # how far the latest stamp was behind its arrival
    last: IntArray = field(default_factory=lambda: np.zeros(len(Status), np.int64))
    """Samples by status at the last check."""
    refused: IntArray = field(default_factory=lambda: np.zeros(len(Status), np.int64))
    """Samples by status at the last check that found a new valid one."""
    marks: deque[tuple[int, IntArray]] = field(default_factory=lambda: deque(maxlen=2))
    rates: deque[tuple[int, int]] = field(default_factory=lambda: deque(maxlen=_RATE_LOOKS))
    cause: str = ''  # the fault of the last check, without its numbers
    looks: int = 0  # checks in a row that found this cause
    reported: str = ''  # the fault that was reported last; '' once it is over

    def take_fault(self, fault: str) -> tuple[str, bool]:
        """Store the fault found by a check, '' for none; report it once when three in a row agree.

        Returns:
            The sentence to log, '' for none, and whether the input has no fault now: the sentence is then
            that of the fault that ended.
        """
        cause = _NUMBERS.sub('', fault)
        self.looks = self.looks + 1 if fault and cause == self.cause else int(bool(fault))
        self.cause, before = cause, self.reported
        if not fault:
            self.reported = ''
            return before, True
        if self.looks < PATIENCE:
            return '', False
        self.reported = fault
        return ('' if cause == _NUMBERS.sub('', before) else fault), False

    def record_counts(self, now_ns: int, counts: IntArray) -> None:
        """Record the counts by status at a time [ns]: for the rate, and for the share of refused samples.

        ``counts`` are samples by :class:`Status`, shape (7,); the array is kept.
        """
        self.rates.append((now_ns, int(counts[Status.ACCEPTED])))
        if not self.marks:
            self.marks.append((now_ns, counts))
            self.refused = counts
        since_ns, before = self.marks[-1]
        if now_ns - since_ns >= SHARE_NS and (counts - before).sum() >= SHARE_SAMPLES:
            self.marks.append((now_ns, counts))
        if counts[Status.ACCEPTED] != self.last[Status.ACCEPTED]:
            self.refused = counts
        self.last = counts

    def rate(self) -> float:
        """Return the rate of valid samples lately [Hz]; ``nan`` while unknown."""
        if len(self.rates) < 2:
            return math.nan
        (begin, before), (end, after) = self.rates[0], self.rates[-1]
        return (after - before) * 1e9 / (end - begin) if end > begin else math.nan


class InputWatch:
    """Faults, rates and ages of the inputs of some bearings; ``now_ns`` is of the steady clock [ns].

    Args:
        bearings: The bearings by name, whose memory is read.
        graph: Knows who publishes on the topics of their inputs.
    """

    def __init__(self, bearings: Mapping[str, BearingMonitor], graph: Graph) -> None:
        self._bearings, self._graph = bearings, graph
        self._tracks: dict[str, dict[int, _Track]] = {
            name: {
                place: _Track(SourceWatch(least_gap(bearing.config, place)))
                for place in bearing.config.places
            }
            for name, bearing in bearings.items()
        }
        self._fitness = {name: FitnessWatch() for name in bearings}
        # What came since it was judged: arrivals [ns] and values of each input
        self._values: dict[tuple[str, int], tuple[list[int], list[float]]] = {
            (name, place): ([], []) for name in bearings for place in _JUDGED
        }
        self._publishers: dict[tuple[str, int], Sequence[Publisher] | None] = {}
        self._seen: dict[str, str] = {}  # who published on a topic when somebody last did
        self._looks = 0
        self._lost = False

    def take(
        self, bearing: str, place: int, value: float, now_ns: int, behind_ns: int, *, valid: bool
    ) -> SourceFault | None:
        """Take a sample: a valid one stores its times, an invalid one nothing.

        A valid speed or load of a sensor is taken by the watch of its source. It, and a level, is also kept
        for the checks of :mod:`.input_fitness`, unless the source sends changes only.

        Args:
            bearing: Name of the bearing.
            place: Index of the input.
            value: The number in the message, in the unit of the input.
            now_ns: When it came, on the steady clock [ns].
            behind_ns: How far its stamp was behind its arrival [ns].
            valid: Whether the rule accepts it.

        Returns:
            The fault of its source that stands, as :meth:`SourceWatch.standing_fault`; ``None`` for none.
        """
        track, live = self._tracks[bearing][place], self._bearings[bearing].settings.live
        if valid:
            track.arrived_ns, track.behind_ns = now_ns, behind_ns
            source = self._bearings[bearing].config.inputs[INPUTS[place]]
            if place in _JUDGED and not source.is_assumed:  # an assumed load has no sensor
                si = si_value(live, place, value)
                # A level that jumps between two values is what is looked for.
                if place != LEVEL:
                    track.source.take(now_ns, si)
                # What stands until the next change is known to come slowly.
                if not source.hold_ns:
                    times, values = self._values[bearing, place]
                    times.append(now_ns)
                    values.append(si)
        return track.source.standing_fault(now_ns)

    def _judge_fitness(self, name: str) -> None:
        """Hand the values of a bearing to its fitness watch once there are 256 of all inputs together.

        They are forgotten then. Each load with a speed of the batch before it makes an operating point there.
        """
        columns = [self._values[name, place] for place in _JUDGED]
        if sum(len(times) for times, _ in columns) < _BATCH:
            return
        watch, arrays = self._fitness[name], []
        for place, (times, values) in enumerate(columns):
            arrays.append((np.array(times, np.int64), np.array(values)))
            watch.take_values(place, *arrays[-1])
            times.clear()
            values.clear()
        (speed_ns, speeds), (load_ns, loads), _ = arrays
        if speed_ns.size:
            latest = np.searchsorted(speed_ns, load_ns, 'right') - 1
            has_speed = latest >= 0
            watch.take_points(load_ns[has_speed], speeds[latest[has_speed]], loads[has_speed])

    def mixed_text(self, bearing: str, now_ns: int) -> str:
        """Return the sentence on a bearing's speed or load that is a mix of two sources; '' for none."""
        standing = (track.source.standing_fault(now_ns) for track in self._tracks[bearing].values())
        return mixed_sentence(self._bearings[bearing].config, standing)

    def states(self, bearing: str, now_ns: int) -> dict[str, InputState]:
        """Return age, rate and reported fault of each input of a bearing, by name; times are steady [ns]."""
        return {
            INPUTS[place]: InputState(_value_age(track, now_ns), track.rate(), track.reported)
            for place, track in self._tracks[bearing].items()
        }

    def explain(self, bearing: str, now_ns: int, *, without_clock: bool) -> str:
        """Return sentences on why inputs of a bearing are lost right now; '' where nothing is known.

        A sender that is just being discovered is left out. The graph is asked again. ``without_clock``: time
        follows ``/clock``, which is silent so far.
        """
        self._publishers.clear()
        lost, texts = self._bearings[bearing].lost_ages(), []
        for place, name in enumerate(QUANTITIES):
            if name in lost:
                facts = self._input_facts(bearing, place, now_ns, without_clock=without_clock)
                fault, track = input_fault(facts), self._tracks[bearing][place]
                is_stable = track.looks >= PATIENCE and track.cause == _NUMBERS.sub('', fault)
                if is_stable or without_clock or facts.undecodable or facts.refused is not None:
                    texts.append(fault)
        return ' '.join(dict.fromkeys(text for text in texts if text))

    def check_inputs(self, now_ns: int, *, without_clock: bool) -> list[tuple[str, str, bool]]:
        """Check every input, once a second; ask the graph each fifth time, or each time while one is lost.

        Args:
            now_ns: Now, on the steady clock.
            without_clock: Whether time follows ``/clock``, which is silent so far.

        Returns:
            Bearing and sentence of each fault that is new or over, and whether it is over.
        """
        self._looks += 1
        if self._lost or self._looks % _GRAPH_PERIOD == 0:
            self._publishers.clear()
        self._lost = False
        faults = []
        for name, tracks in self._tracks.items():
            self._judge_fitness(name)
            for place, track in tracks.items():
                track.record_counts(now_ns, self._bearings[name].counts[place].copy())
                fault = input_fault(self._input_facts(name, place, now_ns, without_clock=without_clock))
                text, is_over = track.take_fault(fault)
                if text:
                    faults.append((name, text, is_over))
        return list(dict.fromkeys(faults))  # that /clock is silent holds for all inputs

    def _input_facts(self, bearing: str, place: int, now_ns: int, *, without_clock: bool) -> InputFacts:
        """Gather the facts on an input; ask the graph for its publishers unless that is cached.

        Caches these, and remembers who publishes on the topic, and that an input is lost.

        Args:
            bearing: Name of the bearing.
            place: Index of the input.
            now_ns: Now, on the steady clock.
            without_clock: As in :meth:`check_inputs`.
        """
        monitor, track = self._bearings[bearing], self._tracks[bearing][place]
        source = monitor.config.inputs[INPUTS[place]]
        lost = monitor.is_lost(place)
        self._lost |= lost
        timeout, source_fault = source.timeout_ns * 1e-9, track.source.standing_fault(now_ns)
        lately = track.last - track.marks[0][1] if track.marks else track.last
        refused, every = lately.copy(), int(lately.sum())
        # A sender of whole seconds repeats itself honestly.
        refused[[Status.ACCEPTED, Status.REPEATED]] = 0
        key = bearing, place
        if key not in self._publishers:
            publishers = self._publishers[key] = self._graph.publishers(source.topic, bearing, place)
            if publishers:
                self._seen[source.topic] = publishers[0].node
        return InputFacts(
            topic=source.topic,
            type=source.type,
            lost=lost,
            publishers=self._publishers[key],
            receiving=_value_age(track, now_ns) < 0.5 * timeout,
            refused=_commonest_refusal(track.last - track.refused),
            share=int(refused.sum()) / every if every >= SHARE_SAMPLES else 0.0,
            reason=_commonest_refusal(refused),
            without_clock=without_clock,
            behind=track.behind_ns * 1e-9,
            undecodable=self._graph.is_undecodable(source.topic),
            gone=self._seen.get(source.topic, ''),
            element=next((step.name for step in source.field if isinstance(step, ByName)), ''),
            other_names=self._graph.other_names(source.topic),
            stuck=place == LEVEL and monitor.unknown is Unknown.STUCK,
            source='' if source_fault is None else fault_text(source_fault, source),
            unfit=self._fitness[bearing].clause(place) if place in _JUDGED else '',
            quantity=INPUTS[place],
        )


def _value_age(track: _Track, now_ns: int) -> float:
    """Return the time since an input's latest valid value [s]; ``inf`` before the first."""
    return math.inf if track.arrived_ns is None else (now_ns - track.arrived_ns) * 1e-9


def _commonest_refusal(counts: IntArray) -> Status | None:
    """Return the reason for which most values were refused; ``None`` where none was.

    ``counts`` are samples by :class:`Status`, of which those accepted do not count.
    """
    refused = counts[Status.ACCEPTED + 1 :]
    return Status(Status.ACCEPTED + 1 + int(refused.argmax())) if refused.any() else None
