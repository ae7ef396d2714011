# SPDX-License-Identifier: Apache-2.0
"""Reports on the inputs of a bearing over a recording: counts, gaps, faults and questions."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stickslip_logs.recordings.recording import Fault, Series
from stickslip_logs.units import SECOND_NS
from stickslip_monitor.arrays import FloatArray, IndexArray, IntArray
from stickslip_monitor.monitor.config_questions import questions
from stickslip_monitor.monitor.input_faults import (
    MOSTLY,
    InputFacts,
    Publisher,
    SourceFault,
    SourceWatch,
    fault_text,
    input_fault,
    least_gap,
)
from stickslip_monitor.monitor.input_fitness import FitnessWatch
from stickslip_monitor.monitor.parameters import BearingConfig
from stickslip_monitor.monitor.rule import si_value
from stickslip_monitor.monitor.rule_over_arrays import Scan
from stickslip_monitor.monitor.rule_settings import settings_of
from stickslip_monitor.monitor.sample_types import INPUTS, LEVEL, STATUS_SENTENCES, Status, Stream
from stickslip_monitor.monitor.statements import duration_text, rounded_text

# Gaps that are named at most, the longest ones.
_MAX_GAPS = 5
COARSE = 10.0
"""From this interval on samples are too far apart for short stick-slip [s]."""
HOLDS = (60, 300, 900, 3600, 14_400, 86_400, 604_800)
"""Times for which a value may stand, of which the next one above the longest gap is named [s]."""
_CROWD, _CROWD_RATE = 100, 1e4
"""So many messages, or more, of which as many would come in a second, have wrong times."""
FASTEST = 30.0
"""Surface speed above which no water-lubricated bearing runs [m/s]."""
FAR_ABOVE = 20.0
"""Speeds never below so many times the fold speed look like another unit: ships serve at 2 to 15 times,
and rpm taken for rad/s are 9.5 times as many, for Hz 60 times."""
FAR_BELOW = 0.2
"""Speeds never above this share of the fold speed look like another unit: ships serve above it."""
APART = 100.0
"""Two levels of a load so far apart, and nothing between, are no bearing's: its unit was changed."""
_MIN_STANDING, _MIN_STANDING_RUNS = 60, 10
_MIN_STANDING_NS = _MIN_STANDING * SECOND_NS
"""So many equal values at the end, for so long [ns], and so many times as many as ever before, are no
sensor's with noise."""
_NOISE_VALUES = 512
"""So many values of a part tell noise."""
_SHARE = 0.05  # of the values of a turning shaft that is worth a question
_NINES = re.compile(r'-?99+(?:\.9+)?0*')
_BINS, _A_DECADE = 64, 4  # of the loads from a millionth of a newton on


@dataclass(frozen=True, slots=True)
class Gap:
    """A time without messages: the last stamp before it [ns] and how long it lasted [s]."""

    start_ns: int
    seconds: float


class Gaps:
    """The rhythm of a topic: the intervals between its stamps, and how its log times go on.

    Attributes:
        count: How many intervals are longer than ``limit_ns``.
        longest: Of these, longest first, at most five.
        usual: The interval that is usual where it begins [s]; nan for fewer than two messages.
    """

    def __init__(self, limit_ns: int) -> None:
        self._limit_ns = limit_ns
        # Messages, and times among their log times; the latest stamp and log time.
        self._messages = self._times = 0
        self._stamp_ns = self._log_ns = 0
        self._regular = self._regular_ns = self._long_ns = self._log_passed_ns = 0
        self._run = self._longest_run = 0
        self.count = 0
        self.longest: list[Gap] = []
        self.usual = math.nan

    def take(self, stamp_ns: IntArray, log_time_ns: IntArray) -> None:
        """Count the intervals of more stamps and log times [ns], shape (n,), in order of arrival.

        Updates counts, gaps and rate. A step back counts as no time.
        """
        if not stamp_ns.size:
            return
        first = int(not self._messages)
        step = _measure_steps(stamp_ns, int(stamp_ns[0]) - 1 if first else self._stamp_ns)
        passed_ns = self._take_intervals(stamp_ns, step[first:])
        if log_time_ns is not stamp_ns:
            step = _measure_steps(log_time_ns, int(log_time_ns[0]) - 1 if first else self._log_ns)
            passed_ns = _time_passed(step[first:])
        self._log_passed_ns += passed_ns
        self._times += int(np.count_nonzero(step))
        runs = np.array([self._run, 1])
        if not step.all():
            runs = np.diff(np.flatnonzero(step), prepend=-self._run, append=step.size)
        self._longest_run, self._run = max(self._longest_run, int(runs.max())), int(runs[-1])
        self._messages += stamp_ns.size
        self._stamp_ns, self._log_ns = int(stamp_ns[-1]), int(log_time_ns[-1])

    def _take_intervals(self, stamp_ns: IntArray, interval: IntArray) -> int:
        """Update counts, times and gaps by the intervals [ns] before some stamps.

        Of the first stamps of all, the first has no interval.

        Returns:
            The sum of the positive intervals [ns].
        """
        if self.usual != self.usual and (interval > 0).any():
            self.usual = float(np.median(interval[interval > 0])) * 1e-9
        long = np.flatnonzero(interval > self._limit_ns)
        lasting_ns = interval[long]
        self.count += long.size
        self._regular += interval.size - long.size
        passed_ns, long_ns = _time_passed(interval), int(lasting_ns.sum())
        self._regular_ns += passed_ns - long_ns
        self._long_ns += long_ns
        if not long.size:
            return passed_ns
        begins = stamp_ns[long + stamp_ns.size - interval.size] - lasting_ns
        order = np.argsort(-lasting_ns, kind='stable')[:_MAX_GAPS]
        gaps = [Gap(int(begins[k]), float(lasting_ns[k] / 1e9)) for k in order]
        self.longest = sorted([*self.longest, *gaps], key=lambda gap: -gap.seconds)[:_MAX_GAPS]
        return passed_ns

    def share(self, repeated_ns: int = 0) -> float:
        """Return the share of the time that the long intervals have, 0 to 1; 0 without any time.

        ``repeated_ns`` is a part of the time that does not count [ns].
        """
        passed_ns = self._regular_ns + self._long_ns - repeated_ns
        return self._long_ns / passed_ns if passed_ns > 0 else 0.0

    @property
    def rate(self) -> float:
        """Messages a second, between the gaps where these are rare [1/s]; nan for fewer than two."""
        count, passed_ns = self._regular, float(self._regular_ns)
        # Of lines that come in triples each third interval is long, and belongs to the rhythm.
        if self.count >= 0.3 * (self._regular + self.count):
            count, passed_ns = count + self.count, passed_ns + self._long_ns
        return count * 1e9 / passed_ns if passed_ns > 0.0 else math.nan

    def crowding_text(self, topic: str) -> str:
        """Return as a clause that too many messages have equal or nearly equal log times; '' if not so."""
        count, longest = self._messages, self._longest_run
        remedy = 'were they recorded without a clock (use_sim_time), or are their times in another unit?'
        is_crowded = count > _CROWD and count > _CROWD_RATE * self._log_passed_ns * 1e-9
        # Two of one time may be a pair of one instant, as a minimum and a maximum.
        if is_crowded or (count > 2 and not self._log_passed_ns):
            return f'{count} messages on {topic} have hardly any time between them: {remedy}'
        # A run ten times as long as is usual shows a clock that stands.
        if longest > _CROWD and longest * self._times > 10 * count:
            return f'{longest} messages on {topic} in a row have one time: nothing is predicted from them'
        return ''


def _measure_steps(time_ns: IntArray, before_ns: int) -> IntArray:
    """Return the step to each time from the one before [ns], shape (n,) for n > 0 times."""
    # A third of what np.diff with a value put before takes.
    step = np.empty_like(time_ns)
    step[0] = time_ns[0] - before_ns
    np.subtract(time_ns[1:], time_ns[:-1], out=step[1:])
    return step


def _time_passed(interval: IntArray) -> int:
    """Return the sum of the positive intervals [ns]."""
    steps_back = interval[interval < 0] if interval.min(initial=0) < 0 else 0
    return int(interval.sum() - np.sum(steps_back))


@dataclass(frozen=True, slots=True)
class InputReport:
    """Result of one input of a bearing."""

    quantity: str  # one of INPUTS
    topic: str
    messages: int  # on the topic
    used: int  # valid samples
    faults: tuple[Fault, ...]  # what was wrong with the others, and jumps of the clock
    gaps: Gaps  # intervals longer than the input's timeout
    span: tuple[float, float] = (math.nan, math.nan)  # of the valid numbers, as in messages
    si_span: tuple[float, float] = (math.nan, math.nan)  # the same in SI; a level in its own unit
    sources: tuple[SourceFault, ...] = ()  # of the source; they are among the faults as well
    questions: tuple[str, ...] = ()  # where the numbers look like another unit or topic
    fault: str = ''  # why it brings nothing, in the words of the running monitor
    is_assumed: bool = False  # a constant that nothing measures
    values: str = 'none'  # the range of the valid ones, for a person
    without_value: int = 0  # messages that hold no number, or one that means "no value"
    crowd: str = ''  # why nothing comes of messages without time between them
    changes_only: bool = False  # whether its source seems to store changes only, and no value may stand
    is_refused: bool = False  # whether so many of its numbers are implausible that it is a fault live, too

    @property
    def loss(self) -> str:
        """The reason why most of the input is lost to the verdict; empty where it is not."""
        return self.crowd or (self.fault if self.is_refused else '')

    @property
    def complaints(self) -> list[str]:
        """The faults of the input, one clause for each kind; empty without any."""
        place = f'{self.quantity} on {self.topic}'
        texts = [f'{place}: {fault.count} x {fault.text}' for fault in self.faults]
        return [*texts, f'{place}: {self.fault}'] if self.fault else texts


class FillerSearch:
    """Finds a number such as -99 or -555 among values, which loggers write where an instrument is silent.

    Args:
        has_peaks: Whether values may jump far and be cut at a limit, as a level: then it is of nines only.
    """

    def __init__(self, *, has_peaks: bool) -> None:
        self._has_peaks = has_peaks
        self._ends = Counter[float]()
        self._count, self._changes, self._low, self._high = 0, 0, math.inf, -math.inf

    def take(self, value: FloatArray) -> None:
        """Take more finite values, shape (n,): count the least and the greatest where they may be fillers.

        They may where they come twice, came as such before, or are of nines alone. All others extend the
        span of the others, and their changes are counted.
        """
        for end in {float(value.min()), float(value.max())} if value.size else ():
            is_end = value == end
            count = int(np.count_nonzero(is_end))
            if count > 1 or end in self._ends or _NINES.fullmatch(f'{end:.10g}'):
                self._ends[end] += count
                value = value[~is_end]
        self._count += value.size
        self._changes += int(np.count_nonzero(value[1:] != value[:-1]))
        self._low, self._high = float(value.min(initial=self._low)), float(value.max(initial=self._high))

    @property
    def filler(self) -> float | None:
        """A number farther from all others than these are apart, or None.

        It comes more than once, but less often than the others. It is of nines, or the others change from
        most values to the next, as those of a sensor do, and it is not between them and zero, as what is at
        rest.
        """
        total = self._count + self._ends.total()
        for number in {min(self._ends), max(self._ends)} if self._ends else ():
            count, ends = self._ends[number], self._ends.keys() - {number}
            rest_count = total - count
            low, high = min(self._low, *ends, math.inf), max(self._high, *ends, -math.inf)
            is_moving = 2 * self._changes > rest_count and not self._has_peaks
            is_beyond = is_moving and not min(low, 0.0) <= number <= max(high, 0.0)
            is_apart = max(low - number, number - high) > high - low
            if is_apart and 1 < count < rest_count and (is_beyond or _NINES.fullmatch(f'{number:.10g}')):
                return number
        return None


class StandingValue:
    """Finds a last value that is repeated to the end, as historians do once its source gives no more.

    Attributes:
        count: How many values at the end are equal.
        equal: How many values, without these, are equal to the one before.
    """

    def __init__(self) -> None:
        self._last, self._since_ns, self._until_ns = math.nan, 0, 0
        self._is_noisy, self._longest = False, 0
        self.count = self.equal = 0

    def take(self, time_ns: IntArray, value: FloatArray) -> None:
        """Take more values in the order of their times [ns], shape (n,); update ``count`` and ``equal``."""
        if not value.size:
            return
        changes = value[1:] != value[:-1]
        is_new = bool(value[0] != self._last)
        if is_new and changes.all():
            # As a rule no value is equal to the one before.
            self.equal += max(self.count - 1, 0)
            self._longest = max(self._longest, self.count if self._last else 0, 1)
            self.count, self._since_ns = 1, int(time_ns[-1])
        else:
            self._take_runs(time_ns, value, np.flatnonzero(np.append(is_new, changes)))
        self._last, self._until_ns = float(value[-1]), int(time_ns[-1])
        self._is_noisy = self._is_noisy or _is_noisy(value[:_NOISE_VALUES])

    def _take_runs(self, time_ns: IntArray, value: FloatArray, starts: IntArray) -> None:
        """Update the counts by runs of equal values, shape (n,) at times [ns]; the first continues the last.

        ``starts`` are the indexes at which runs begin, ascending.
        """
        if starts.size:
            # Values at rest repeat as well.
            runs, of = np.diff(starts, prepend=-self.count), np.append(self._last, value[starts[:-1]])
            self._longest = max(self._longest, int(runs[of != 0.0].max(initial=0)))
            self.equal += int(runs.sum()) - runs.size + (self.count == 0)
            self.count, self._since_ns = 0, int(time_ns[starts[-1]])
        self.count += value.size - (int(starts[-1]) if starts.size else 0)

    @property
    def lasting_ns(self) -> int:
        """Time that the equal values at the end last [ns]; 0 for less than a minute or fewer than sixty."""
        lasting_ns = self._until_ns - self._since_ns
        return lasting_ns if self.count >= _MIN_STANDING and lasting_ns >= _MIN_STANDING_NS else 0

    @property
    def clause(self) -> str:
        """Question on a value that stands at the end behind those of a sensor, after its name; else ''."""
        seconds, is_longest = self.lasting_ns * 1e-9, self.count >= _MIN_STANDING_RUNS * self._longest
        if not (seconds and is_longest and self._is_noisy and self._last):
            return ''
        return (
            f'is exactly {self._last:g} for the last {duration_text(seconds)}, and changed from value to'
            ' value before: did its source end, and is its last value repeated? Then leave these lines out'
        )


def _is_noisy(value: FloatArray) -> bool:
    """Return whether most steps between some values are changes, many of which turn back."""
    before, behind = value[:-1], value[1:]
    is_rising = (behind > before)[behind != before]
    turns = int(np.count_nonzero(is_rising[1:] != is_rising[:-1]))
    return value.size >= _MIN_STANDING and 2 * is_rising.size > value.size and 4 * turns > is_rising.size


class InputCheck:
    """Adds up counts, gaps and faults of one input of a bearing.

    Args:
        config: The bearing.
        place: The input, a place in :data:`.sample_types.INPUTS`.
        absent: Why the recording lacks it; '' if it is there.
    """

    def __init__(self, config: BearingConfig, place: int, absent: str = '') -> None:
        self.quantity = INPUTS[place]
        self._place, self._absent = place, absent
        self._source = config.inputs[self.quantity]
        self._assumed = config.load.assumed if self.quantity == 'load' else None
        self._gear = f' {config.speed.gear_text}'.rstrip() if self.quantity == 'speed' else ''
        self._numbers = settings_of(config).live
        self._counts = np.zeros(len(Status), np.int64)
        self.gaps = Gaps(self._source.stands_ns)
        """The rhythm of its messages."""
        self._standing = StandingValue()
        self._watch = SourceWatch(least_gap(config, place))
        self._sources: list[SourceFault] = []
        self._span = math.inf, -math.inf
        self._fillers = FillerSearch(has_peaks=place == LEVEL)
        self._messages = self._delay_ns = 0

    def take(self, series: Series, stream: Stream, scan: Scan, fitness: FitnessWatch) -> None:
        """Add up the next part of the input; pass its valid values to the bearing's ``fitness``.

        Args:
            series: The samples of this input as recorded.
            stream: The samples of all inputs of the bearing.
            scan: The verdicts on them.
            fitness: Updated by speed, load and level, unless assumed or held.
        """
        self._messages += series.value.size
        if series.value.size:
            self._delay_ns = int(series.log_time_ns[-1] - series.stamp_ns[-1])
        self.gaps.take(series.stamp_ns, series.log_time_ns)
        if series.value.size and not self._source.hold_ns:
            self._standing.take(series.log_time_ns, series.value)
        self._counts += scan.counts[self._place]
        value, arrival_ns, numbers = series.value, series.log_time_ns, series.value
        if scan.counts[self._place, Status.ACCEPTED] < value.size:
            is_own = stream.inputs == self._place
            is_used = is_own & (scan.status == Status.ACCEPTED)
            numbers = stream.value[is_own & ~np.isin(scan.status, (Status.NO_VALUE, Status.NOT_FINITE))]
            value, arrival_ns = stream.value[is_used], stream.arrival_ns[is_used]
        if self._place <= LEVEL and not self._source.is_assumed:  # an assumed load has no sensor
            si = self._to_si(value)
            # A level may jump between two values: that is a vibration.
            if self._place < LEVEL:
                self._sources += self._watch.take_column(arrival_ns, si)
            # What stands until the next change is known to come slowly.
            if not self._source.hold_ns:
                fitness.take_values(self._place, arrival_ns, si)
        self._fillers.take(numbers)
        low, high = self._span
        self._span = float(value.min(initial=low)), float(value.max(initial=high))

    def _to_si(self, number: Any) -> Any:
        """Return a number as sent, or an array of them, in SI; ``inf`` for what is too large."""
        with np.errstate(over='ignore', invalid='ignore'):
            return si_value(self._numbers, self._place, number)

    def _describe_fault(self) -> str:
        """Return the sentence on why an input is absent, silent, mostly refused or stamped off its arrival.

        '' if nothing is wrong.
        """
        if self._absent:
            return f'{self._absent}.'
        facts = InputFacts(self._source.topic, self._source.type, lost=True)
        if not self._messages:
            return input_fault(facts)
        if not self._counts[Status.ACCEPTED]:
            worst = max(Status, key=lambda status: int(self._counts[status]))
            sender = (Publisher('', self._source.type),)
            return input_fault(replace(facts, publishers=sender, refused=worst))
        received = replace(facts, lost=False, receiving=True, behind=self._delay_ns * 1e-9)
        share = int(self._counts[Status.IMPLAUSIBLE]) / self._messages
        return input_fault(replace(received, share=share, reason=Status.IMPLAUSIBLE))

    def report(self, faults: tuple[Fault, ...], questions: tuple[str, ...], clock: str) -> InputReport:
        """Return the report on the input, with questions on fillers and on a last value that stands.

        Args:
            faults: The faults of its messages.
            questions: Further questions: clauses that follow the name of the input.
            clock: The fault of the recording's clock, which replaces others; '' if it has none.
        """
        used = int(self._counts[Status.ACCEPTED])
        if self._assumed is not None:
            # An assumed load has the messages of the speed, whose report has their faults.
            low, high = (load / self._source.factor for load in self._assumed)
            of_table = f'{_range_text(low, high)} {self._source.unit} from the alignment table'
            values = of_table if low < high else f'{low:g} {self._source.unit}'
            topic = self._source.topic
            common = self.quantity, topic, self._messages, used, (), self.gaps, (low, high), self._assumed
            return InputReport(*common, questions=questions, is_assumed=True, values=values)
        changes_only = self._stores_changes_only()
        if self._place < LEVEL and not changes_only and (standing := self._standing.clause):
            questions += (standing,)
        if (filler := self._fillers.filler) is not None:
            questions += (
                f'has {filler:g} far from all other values: leave it out of the recording if it means that'
                ' there is no value',
            )
        first, last = self._span if used else (math.nan, math.nan)
        low, high = sorted(float(self._to_si(end)) for end in (first, last))
        counted = {text: int(self._counts[status]) for status, text in STATUS_SENTENCES.items()}
        # A word of a table is counted by its own fault.
        counted[STATUS_SENTENCES[Status.NOT_FINITE]] -= sum(fault.count for fault in faults if fault.is_nan)
        counted |= Counter(fault_text(fault, self._source) for fault in self._sources)
        return InputReport(
            quantity=self.quantity,
            topic=self._source.topic,
            messages=self._messages,
            used=used,
            faults=(*faults, *(Fault(count, text) for text, count in counted.items() if count > 0)),
            gaps=self.gaps,
            span=(first, last),
            si_span=(low, high),
            sources=tuple(self._sources),
            questions=questions,
            fault=clock or self._describe_fault(),
            values=self._range_of_values(first, last, low, high) if used else 'none',
            without_value=int(self._counts[[Status.NO_VALUE, Status.NOT_FINITE]].sum()),
            crowd=self.gaps.crowding_text(self._source.topic),
            changes_only=changes_only,
            is_refused=int(self._counts[Status.IMPLAUSIBLE]) >= MOSTLY * max(self._messages, 1),
        )

    def _stores_changes_only(self) -> bool:
        """Return whether the source stores changes only, and ``hold`` does not say so already.

        Then two gaps or more have half of the time, and outside of gaps at most 1 % of the values are that
        before: of a sensor of two digits a tenth and more are.
        """
        gaps, equal = self.gaps, max(0, self._standing.equal - self.gaps.count)
        is_sparse = gaps.count >= 2 and gaps.share(self._standing.lasting_ns) >= 0.5
        return is_sparse and not self._source.hold_ns and equal <= 0.01 * self._messages

    def _range_of_values(self, first: float, last: float, si_low: float, si_high: float) -> str:
        """Format the range of valid values in the configured unit, in SI, and as sent if scaled.

        Args:
            first: The least value as sent.
            last: The greatest value as sent.
            si_low: The least value [SI].
            si_high: The greatest value [SI].
        """
        source = self._source
        low, high = sorted(source.scale * end + source.offset for end in (first, last))
        si_unit = {'speed': 'm/s', 'load': 'N'}.get(self.quantity, source.unit)
        more = [f'{_range_text(si_low, si_high)} {si_unit}'] if si_unit != source.unit else []
        if (source.scale, source.offset) != (1.0, 0.0):
            more.append(f'sent as {_range_text(first, last)}')
        return f'{_range_text(low, high)} {source.unit}{self._gear}' + (
            f' ({"; ".join(more)})' if more else ''
        )


def _range_text(low: float, high: float) -> str:
    """Return a range as ``LOW to HIGH``, both to four digits."""
    return f'{rounded_text(low, 4)} to {rounded_text(high, 4)}'


class Plausibility:
    """Judges the inputs of a bearing by all operating points of a recording."""

    def __init__(self, config: BearingConfig) -> None:
        self._config = config
        self._count = self._negative = self._moving = self._unloaded = 0
        self._fastest = self._heaviest = 0.0
        self._loads = np.zeros(_BINS, np.int64)  # how many are of each fourth of a decade
        # The greatest speed of the turning shaft relative to the fold; inf once one has no fold.
        self._max_ratio = -math.inf

    def take(self, speed: FloatArray, load: FloatArray, limit: Callable[[IndexArray], FloatArray]) -> None:
        """Count more operating points; compute fold speeds only while none is fast enough to be plausible.

        Args:
            speed: Surface speeds of any sign [m/s], shape (n,).
            load: Loads [N], shape (n,).
            limit: Returns the fold speeds [m/s] of the points at some indices; nan without a fold, which
                counts as fast enough.
        """
        speed = np.abs(speed)
        turns = speed > 0.0
        self._count += speed.size
        self._fastest = float(speed.max(initial=self._fastest))
        self._heaviest = float(load.max(initial=self._heaviest))
        self._moving += int(np.count_nonzero(turns))
        if load.min(initial=math.inf) <= 0.0:
            self._negative += int(np.count_nonzero(load < 0.0))
            self._unloaded += int(np.count_nonzero(turns & (load == 0.0)))
            turns &= load > 0.0
        self._loads += _count_by_size(load if turns.all() else load[turns])
        if self._max_ratio < FAR_BELOW and turns.any():
            rows = np.flatnonzero(turns)
            # As a rule the fastest is fast enough, and no more is to be computed.
            for chosen in (rows[speed[rows].argmax()][None], rows):
                if self._max_ratio < FAR_BELOW:
                    ratio = speed[chosen] / limit(chosen)
                    ratio[np.isnan(ratio)] = np.inf
                    self._max_ratio = max(self._max_ratio, float(ratio.max()))

    def questions(self, nearest: float) -> dict[str, list[str]]:
        """Return questions on all points so far: lists under ``speed`` and ``load``, empty without any.

        Each is a clause that follows the name of the input.

        Args:
            nearest: The least speed of the turning shaft relative to the fold; inf for none.
        """
        config = self._config
        texts = questions(config, self._heaviest)
        if self._fastest > FASTEST:
            texts['speed'].append(
                f'reaches {self._fastest:.4g} m/s at the surface of the journal, more than'
                f' {FASTEST:g} m/s: are its unit and scale right?'
            )
        if self._negative > 0.5 * self._count:
            texts['load'].append('is negative for most of the time: is the sign of its scale right?')
        if self._unloaded > _SHARE * self._moving:
            texts['load'].append(
                f'is exactly 0 in {self._unloaded / self._moving:.0%} of the values while the shaft turns: is'
                ' the sensor connected, are its topic and field right?'
            )
        texts['load'] += self._level_questions()
        if self._loads.any() and not texts['speed']:
            texts['speed'] += self._distance_questions(nearest)
        return texts

    def _distance_questions(self, nearest: float) -> list[str]:
        """Return a question on units in a list if all points are far from the fold; else an empty list.

        That is above :data:`FAR_ABOVE` or below :data:`FAR_BELOW` times the fold speed.
        ``nearest`` is the least speed of the turning shaft relative to the fold; inf for none.
        """
        question = 'are units, scales and topics of speed and load right?'
        if FAR_ABOVE < nearest < math.inf:
            return [f'is never below {nearest:.3g} times the fold speed: {question}']
        if self._max_ratio < FAR_BELOW:
            return [f'is never above {self._max_ratio:.2g} times the fold speed: {question}']
        return []

    def _level_questions(self) -> list[str]:
        """Return a question in a list if the loads have two levels, as of N and kN; else an empty list."""
        share = np.cumsum(self._loads) / max(int(self._loads.sum()), 1)
        places = np.flatnonzero(self._loads > 0.001 * self._loads.sum())
        for below, above in zip(places[:-1].tolist(), places[1:].tolist(), strict=True):
            lower_n, upper_n = (10.0 ** (place / _A_DECADE - 6.0) for place in (below + 1, above))
            if upper_n >= 0.999 * APART * lower_n and _SHARE < share[below] < 1.0 - _SHARE:
                return [
                    f'is below {lower_n:.3g} N in {share[below]:.0%} of the values and above {upper_n:.3g} N'
                    ' in the others, with nothing between: was its unit or sensor changed?'
                ]
        return []


def _count_by_size(load: FloatArray) -> IntArray:
    """Count loads > 0 [N] by quarter of a decade from 1e-6 N on, shape (_BINS,).

    Those below the first or above the last quarter count in it.
    """
    counts = np.zeros(_BINS, np.int64)
    if load.size:
        # Most recordings have all in a few, and comparing takes less than a logarithm of each.
        ends = np.floor(_A_DECADE * (np.log10([load.min(), load.max()]) + 6.0)).clip(0, _BINS - 1)
        first, last = ends.astype(int).tolist()
        edges = 10.0 ** (np.arange(first + 1, last + 1) / _A_DECADE - 6.0)
        above = [load.size, *(int(np.count_nonzero(load >= edge)) for edge in edges), 0]
        counts[first : last + 1] = -np.diff(above)
    return counts
