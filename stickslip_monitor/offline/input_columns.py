# SPDX-License-Identifier: Apache-2.0
"""Finds the column of a log that an input of a configuration is, and the unit of its numbers."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from stickslip_logs.errors import listed, quote_for_yaml
from stickslip_logs.recordings.table_columns import FLOAT64, LogColumn, SourceColumn
from stickslip_logs.recordings.table_recording import TableRecording
from stickslip_logs.tables.dialect import FORCE_WORDS, parse_heading, unit_of
from stickslip_logs.time_order import MAX_TIME_NS
from stickslip_logs.units import UNITS, affine_conversion, find_unit
from stickslip_monitor.errors import BagError, did_you_mean
from stickslip_monitor.monitor.parameters import (
    LOAD_UNITS,
    BearingConfig,
    InputConfig,
    MonitorConfig,
    SpeedConfig,
)
from stickslip_monitor.monitor.sample_types import NO_VALUES, QUANTITIES
from stickslip_monitor.physics.bearing import TURNING_UNITS

# A column is taken by its unit only if its heading has one of these words, or is a unit, and no others than
# these, those of its bearing and topic, and numbers: what else has the unit is named by its owner.
_HEADINGS = {
    'speed': {
        *('speed', 'rpm', 'shaftrpm', 'revolutions', 'revolution', 'revs', 'n', 'drehzahl', 'wellendrehzahl'),
        *('propellerdrehzahl', 'rotational', 'rotation', 'shaft', 'propeller', 'welle'),
    },
    # The thrust is not a load of a stern bearing.
    'load': FORCE_WORDS - {'thrust'} | {'f', 'bearing', 'brg', 'lagerkraft', 'lagerlast'},
}
_BESIDE = {
    *('prop', 'lager', 'sensor', 'measured', 'actual', 'value'),
    *('mean', 'avg', 'average', 'of', 'the'),
}


@dataclass(frozen=True, slots=True)
class Bound:
    """A configuration as it holds for one recording.

    Attributes:
        config: The configuration, with the topics and the timeouts that hold for the recording.
        absent: Why an input is not in the recording, by bearing and quantity.
        questions: Questions on an input by bearing and quantity: clauses that follow its name.
    """

    config: MonitorConfig
    absent: Mapping[tuple[str, str], str] = field(default_factory=dict)
    questions: Mapping[tuple[str, str], str] = field(default_factory=dict)


class ColumnBinding:
    """Finds the columns of a log that are the inputs of a configuration."""

    def __init__(self, log: TableRecording) -> None:
        self._log, self._path, self._all = log, log.path, log.all_columns
        # Columns to deliver, by the topic that each stands for, and questions by bearing and quantity.
        self._columns: dict[str, SourceColumn] = {}
        self._questions: dict[tuple[str, str], str] = {}
        self._asked_clocks: set[tuple[int, ...]] = set()

    def bind(self, config: MonitorConfig) -> Bound:
        """Bind every input that is not assumed to one column of the log.

        The log is set to deliver the columns, and gets notes on what was guessed. An assumed load gets the
        column of the speed.

        Returns:
            The configuration with topics and timeouts for the log; why other inputs are absent: no single
            column fits, or bearings with different topics share one; and the questions.
        """
        absent: dict[tuple[str, str], str] = {}
        columns: list[tuple[BearingConfig, str, InputConfig, LogColumn]] = []
        for bearing in config.bearings:
            for quantity, source in bearing.inputs.items():
                try:
                    if not source.is_assumed:
                        columns.append(
                            (bearing, quantity, source, self._find_column(bearing, quantity, source))
                        )
                except BagError as error:
                    absent[bearing.name, quantity] = str(error)
        bound: dict[str, dict[str, Any]] = {bearing.name: {} for bearing in config.bearings}
        for bearing, quantity, source, column in columns:
            topics = {row[2].topic for row in columns if (row[1], row[3]) == (quantity, column)}
            is_named = source.column or _is_named_after(column, bearing.name, source.topic)
            if len(topics) > 1 and not is_named:
                absent[bearing.name, quantity] = (
                    f"log '{self._path}': column '{column.heading}' is the {quantity} of one bearing, and"
                    f' {len(topics)} have different topics: check it with --bearing {bearing.name} or'
                    f' another, or if it is that of all, write {bearing.name}.{quantity}.column:'
                    f' {quote_for_yaml(self._name_of(column))}, and so for each'
                )
            else:
                bound[bearing.name][quantity] = self._bind_column(bearing, quantity, source, column)
        for bearing in config.bearings:
            inputs = bound[bearing.name]
            if bearing.load.is_assumed and 'speed' in inputs:
                # An assumed load has no column: it uses that of the speed.
                names = ('topic', 'type', 'field_text', 'field', 'timeout_ns', 'hold_ns')
                inputs['load'] = replace(bearing.load, **{k: getattr(inputs['speed'], k) for k in names})
            elif bearing.load.is_assumed:
                absent[bearing.name, 'load'] = absent[bearing.name, 'speed']
        bearings = tuple(replace(bearing, **bound[bearing.name]) for bearing in config.bearings)
        self._log.deliver(self._columns)
        return Bound(replace(config, bearings=bearings), absent, self._questions)

    def _find_column(self, bearing: BearingConfig, quantity: str, source: InputConfig) -> LogColumn:
        """Return the one column that is an input, with only the rows selected by ``where``.

        Raises:
            BagError: No column fits, or several do; ``where`` names a column or a text that is not there; or
                its rows are of several things, by another column.
        """
        if source.column:
            columns = self._columns_called(source.column)
        else:
            columns = self._guess_columns(bearing.name, quantity, source)
        if len(columns) > 1:
            # Another sender of a number stands in for the first.
            columns = [column for column in columns if not column.is_other] or columns
            named = [column for column in columns if _is_named_after(column, bearing.name)]
            columns = named if len(named) == 1 else columns
        if len(columns) != 1:
            raise BagError(self._no_column_text(bearing.name, quantity, source, columns))
        column = self._log.choose_rows(replace(columns[0], sender=source.sender), source.where_texts)
        if (key := self._log.find_unchosen_key(column)) is None:
            return column
        heading, texts = key
        pairs = {heading: texts[0], **source.where_texts}
        line = ', '.join(f'{quote_for_yaml(name)}: {quote_for_yaml(text)}' for name, text in pairs.items())
        raise BagError(
            f"log '{self._path}': the lines of '{column.heading}' are of several things, told apart by column"
            f" '{heading}' ({listed(texts)}): write {bearing.name}.{quantity}.where:"
            f' {{{line}}}, and a bearing for each'
        )

    def _no_column_text(
        self, bearing: str, quantity: str, source: InputConfig, candidates: Sequence[LogColumn]
    ) -> str:
        """Return the text of the error that none, or several, of the candidates are an input of a bearing.

        It has the line to write, with the likeliest of all columns where there is no candidate.
        """
        names = [self._name_of(column) for column in candidates or self._all]
        if source.column and not candidates:
            remedy = did_you_mean(source.column, names)
            if of := self._log.find_column_with(source.column):
                pair = f'{quote_for_yaml(of)}: {quote_for_yaml(source.column)}'
                remedy = f"; it is a text of column '{of}': write {bearing}.{quantity}.where: {{{pair}}}"
                remedy += ' beside the column of its numbers'
            return (
                f"log '{self._path}' has no column '{source.column}' ({bearing}.{quantity}.column): it has"
                f' {listed(names)}{remedy}'
            )
        # A unit says more than all words of a heading, but for a force, which may be the thrust.
        words, units = _HEADINGS.get(quantity, set()), _units_of(quantity, source)
        scores = {
            self._name_of(column): len(words & {*name.split()})
            + 9 * (bool(candidates) or (quantity != 'load' and column.unit in units))
            for column, name in self._possible_columns(quantity, units)
            if column in (candidates or self._all)
        }
        likely = max(scores, key=scores.__getitem__, default='')
        line = f'{quote_for_yaml(likely)}, or another' if scores.get(likely) else 'NAME'
        if quantity == 'load':
            line += f', or {bearing}.load.constant or .over_speed'
        elif isinstance(source, SpeedConfig) and not source.gear_text:
            line += f", and {bearing}.speed.gear where it is an engine's"
        count = f'{len(candidates)} columns may be' if candidates else 'no column looks like'
        return (
            f"log '{self._path}': {count} the {quantity} of {bearing} by unit or name (columns:"
            f' {listed(names)}): write {bearing}.{quantity}.column: {line}'
        )

    def _name_of(self, column: LogColumn) -> str:
        """Return by what a configuration names a column: its heading, or its place where several share it."""
        headings = [c.heading for c in self._all]
        return column.heading if headings.count(column.heading) == 1 else f'#{column.place + 1}'

    def _columns_called(self, heading: str) -> Sequence[LogColumn]:
        """Return all columns with a heading, else with its words, else column N for ``#N``, else none."""
        name = _plain_name(heading)
        same = [column for column in self._all if column.heading == heading]
        similar = [column for column in self._all if name and _plain_name(column.heading) == name]
        # In a log of one value a line a number stands for all rows of the column of values.
        numbered = [
            column if column.name is None else LogColumn(heading, column.place)
            for column in self._all
            if f'#{column.place + 1}' == heading
        ]
        return same or similar or numbered[:1]

    def _guess_columns(self, bearing: str, quantity: str, source: InputConfig) -> Sequence[LogColumn]:
        """Return the columns that may be an input, by the first of four rules that any column meets.

        The heading is the topic; or has the words of the topic; or has a unit of the quantity and, in a log
        that no bus sent, no words but plain ones (:func:`_is_plain`); or has the words of the quantity. On a
        bus plain ones come first, and with a gear the others. No column in another unit meets any. Empty if
        none does.
        """
        topic = source.topic.strip('/')
        units = _units_of(quantity, source)
        candidates = self._possible_columns(quantity, units)
        # PlotJuggler writes the field behind the topic.
        of_topic = [
            column
            for column, _ in candidates
            if topic and column.heading.strip('/') in (topic, f'{topic}/{source.field_text}')
        ]
        topic_names = {parse_heading(topic).name, parse_heading(topic.rpartition('/')[2]).name} - {quantity}
        similar = [column for column, name in candidates if name in topic_names]
        by_unit = [
            column
            for column, _ in candidates
            if column.unit in (units if quantity in QUANTITIES else (source.unit,))
        ]
        # A bus has names of its own: 'RPM S 1' is a shaft's, and not of an engine with a gear.
        words = _own_words(bearing, topic) | {'s'} if self._log.is_sent else _own_words(bearing, topic)
        has_gear = self._log.is_sent and isinstance(source, SpeedConfig) and bool(source.gear_text)
        plain = [column for column in by_unit if _is_plain(column, quantity, words) != has_gear]
        by_unit = plain or by_unit if self._log.is_sent else plain
        own_names = {quantity, parse_heading(f'{bearing} {quantity}').name}
        by_name = [column for column, name in candidates if name in own_names]
        return of_topic or similar or by_unit or by_name

    def _possible_columns(self, quantity: str, units: tuple[str, ...]) -> list[tuple[LogColumn, str]]:
        """Return the columns, each with its plain name, whose unit fits a quantity.

        A column in another unit is another quantity: 'Speed (kn)' is the ship's own.
        """
        names = [(column, parse_heading(column.heading).name) for column in self._all]
        return [
            (column, name)
            for column, name in names
            if _unit_of_column(column, quantity) in units or not column.has_unit
        ]

    def _bind_column(
        self, bearing: BearingConfig, quantity: str, source: InputConfig, column: LogColumn
    ) -> InputConfig:
        """Return an input as read from a column; store the column and questions, note what was guessed.

        Topic, column, type, field and timeout are replaced by those that hold for the log.
        """
        unit = _unit_of_column(column, quantity)
        unit = unit if unit in _units_of(quantity, source) else None
        # Over a bus comes what the sensor sent, and a scale beside a named column is meant.
        is_scaled = unit is not None and not (self._log.is_sent or source.column)
        use = _ColumnUse(bearing, quantity, source, column, unit, is_scaled)
        interval = self._log.interval(column)
        timeout_ns = source.timeout_ns
        # What came over a bus is as old as live, but where a clock that comes seldom gives the times. A value
        # counts for three intervals, because a lost line is no lost input.
        if not self._log.is_sent or self._log.shares_times(column):
            timeout_ns = max(min(round(3.0 * interval * 1e9), MAX_TIME_NS), timeout_ns)
        stands = max(timeout_ns, source.hold_ns) * 1e-9
        sent = replace(use.conversion(), timeout=stands if self._log.is_sent else None)
        topic = source.topic
        if not topic or self._columns.get(topic, sent) != sent:
            topic = f'/{bearing.name}/{quantity}'
        self._columns[topic] = sent
        remark = use.remark()
        if timeout_ns > source.timeout_ns:
            remark += f'; lines are {interval:.4g} s apart, so its timeout is {timeout_ns * 1e-9:.4g} s here'
        elif interval * 1e9 > source.timeout_ns:
            remark += (
                f'; its numbers are {interval:.4g} s apart, more than its timeout of'
                f' {timeout_ns * 1e-9:.4g} s, as live: write {bearing.name}.{quantity}.timeout'
            )
        self._log.note(remark)
        if clauses := [*use.questions(), *self._questions_on_values(source, column, interval)]:
            self._questions[bearing.name, quantity] = '; and '.join(clauses)
        return replace(
            source,
            topic=topic,
            column=column.heading,
            type=FLOAT64,
            field_text='data',
            field=('data',),
            timeout_ns=timeout_ns,
        )

    def _questions_on_values(self, source: InputConfig, column: LogColumn, interval: float) -> Iterator[str]:
        """Yield questions on ambiguous times and numbers, unknown marks of quality, and slow values.

        A clock is asked about once, with the first input that has its times; that is stored. Each question is
        a clause that follows the name of the input; ``interval`` is that of the values [s].
        """
        clock = self._log.table.clocks_of([column.place])[0]
        if clock.question and clock.columns not in self._asked_clocks:
            self._asked_clocks.add(clock.columns)
            yield clock.question
        if number := self._log.ambiguous_number(column):
            whole = number.replace(',', '').replace('.', '')
            yield f"has '{number}', read with decimals: write {number}0 or {whole}, which are certain"
        if marks := self._log.unknown_marks(column):
            heading, texts = marks
            yield (
                f"has beside it column '{heading}' with {listed(texts)}: write the lines that count, as in"
                f' where: {{{quote_for_yaml(heading)}: {quote_for_yaml(texts[0])}}}'
            )
        # Reports of each hour or noon: a coast-down takes minutes.
        if interval >= 1800.0 and not source.hold_ns:
            yield (
                f'has a value each {interval:.4g} s, which cannot judge what a shaft does in minutes: is'
                ' there a log with one each 10 s or less?'
            )


@dataclass(frozen=True, slots=True)
class _ColumnUse:
    """A column as the input of a bearing that it is."""

    bearing: BearingConfig
    quantity: str
    source: InputConfig  # as configured
    column: LogColumn
    unit: str | None  # that its heading states; None if it states none that converts
    is_scaled: bool  # whether the values have the scale of the configuration already

    @property
    def _has_scale(self) -> bool:
        """Whether a scale or an offset is configured."""
        return (self.source.scale, self.source.offset) != (1.0, 0.0)

    @property
    def _gear(self) -> str:
        """The gear of a speed in words; empty without one."""
        return self.source.gear_text if isinstance(self.source, SpeedConfig) else ''

    def conversion(self) -> SourceColumn:
        """Return the column with the conversion of its numbers to the configured unit; without a timeout.

        Numbers whose heading states no unit that converts are taken as they are.
        """
        if self.unit is None:
            return SourceColumn(self.column)
        source = self.source
        ratio, bias = affine_conversion(self.unit, source.unit) or (1.0, 0.0)
        if self.quantity == 'speed' and self.unit != source.unit:
            speed = self.bearing.bearing.speed
            ratio, bias = speed.factor(self.unit) / speed.factor(source.unit), 0.0
        scale, offset = (source.scale, source.offset) if self.is_scaled else (1.0, 0.0)
        return SourceColumn(self.column, ratio, scale, offset - bias, no_values=NO_VALUES)

    def remark(self) -> str:
        """Return which column the input is, with unit, scale or gear, as a sentence without a full stop."""
        name, source = self.bearing.name, self.source
        why = 'by its heading' if self.unit else f'as {name}.{self.quantity}.unit says'
        unit = self.unit or source.unit
        remark = f"{self.quantity} of {name} is column '{self.column.heading}' in {unit}, {why}"
        if not self._has_scale:
            return f'{remark}, {self._gear}' if self._gear else remark
        if self.is_scaled:
            return f'{remark}, taken as scaled already'
        offset = f' and with its offset {source.offset:g}' if source.offset else ''
        return f'{remark}, times its scale {source.scale:g}{offset}'

    def questions(self) -> Iterator[str]:
        """Yield questions on unit and scale, and on whether a speed or a load is the bearing's own.

        Each is a clause that follows the name of the input.
        """
        source, column, name = self.source, self.column, self.bearing.name
        parameter = f'{name}.{self.quantity}'
        if self.unit is None and column.has_unit and not (self._has_scale or source.column[:1] == '#'):
            stated = column.unit or parse_heading(column.heading).unit
            if stated is None or stated.strip('\u00b0 ').upper() != source.unit.upper():
                place = '' if column.name else f"{parameter}.column: '#{column.place + 1}' if so, else "
                yield (
                    f"is column '{column.heading}' in {source.unit}, and its heading says '{stated}': write"
                    f' {place}{parameter}.scale'
                )
        if self.is_scaled and self._has_scale:
            yield (
                f"is column '{column.heading}' in {self.unit} by its heading, so its scale {source.scale:g}"
                f' and offset {source.offset:g} are not applied: write'
                f' {parameter}.column: "{column.heading}" if they are to be'
            )
        elif self.quantity in QUANTITIES and not (self._has_scale or source.column):
            # A gear is of an engine, whose speed only its owner or the topic tells from the shaft's.
            is_own = _is_named_after(column, '' if self._gear else name, source.topic)
            is_plain = _is_plain(column, self.quantity, _own_words(name, source.topic) | {'s'})
            if not (is_own or (is_plain and not self._gear)):
                gear = f', and {parameter}.gear where one is between' * (
                    self.quantity == 'speed' and not self._gear
                )
                owner = 'engine' if self._gear else 'shaft' if self.quantity == 'speed' else 'bearing'
                line = f'{parameter}.column: {quote_for_yaml(column.heading)}'
                yield f"is column '{column.heading}': is it the {owner}'s own? Write {line}{gear}"


def _plain_name(heading: str) -> str:
    """Return the words of a heading without unit, numbers without leading zeros: 'RPM S 01' is 'rpm s 1'."""
    return re.sub(r'\b0+(?=\d)', '', parse_heading(heading).name)


def _own_words(bearing: str, topic: str) -> set[str]:
    """Return the words of a bearing's name and of a topic, in lower case."""
    return {*parse_heading(f'{bearing} {topic.replace("/", " ")}').name.split()}


def _is_named_after(column: LogColumn, bearing: str, topic: str = '') -> bool:
    """Return whether a heading has all words of a bearing's name, in any case, or begins with a topic.

    Slashes at the ends of either do not count; an empty topic begins no heading.
    """
    is_topic = bool(topic) and column.heading.strip('/').startswith(topic.strip('/'))
    return is_topic or {*bearing.split('_')} <= {*parse_heading(column.heading).name.split()}


def _is_plain(column: LogColumn, quantity: str, other_words: set[str]) -> bool:
    """Return whether a heading names the quantity, or only a unit, and has no words beyond the allowed.

    Allowed are words of the quantity, of a unit and of measurement, numbers, and ``other_words``.
    """
    words = {word for word in parse_heading(column.heading).name.split() if not word.isdecimal()}
    unit = {*parse_heading(parse_heading(column.heading).unit or '').name.split()}
    unit |= {word for word in words if unit_of(word, 'force')}
    names = _HEADINGS.get(quantity, set())
    return bool(words & names or words <= unit) and words <= names | _BESIDE | other_words | unit


def _unit_of_column(column: LogColumn, quantity: str) -> str | None:
    """Return the unit of a column as the configuration calls it; None where its heading has none of these."""
    if quantity != 'water_temperature':
        return column.unit
    last = column.heading.replace('_', ' ').rpartition(' ')[2]
    texts = (parse_heading(column.heading).unit or '', last if len(last) > 1 else '')
    return next((unit.name for text in texts if (unit := find_unit(text, 'temperature'))), None)


def _units_of(quantity: str, source: InputConfig) -> tuple[str, ...]:
    """Return the units that a column may have.

    For a speed they are those of turning, and m/s last, only if that is configured; else the configured unit
    and, behind it, all that convert to it.
    """
    if quantity == 'speed':
        # A column in m/s may be the ship's own speed.
        return (*TURNING_UNITS, *(['m/s'] if source.unit == 'm/s' else []))
    return (
        source.unit,
        *(unit.name for unit in UNITS if affine_conversion(unit.name, source.unit) is not None),
    )


def quantity_hint(kind: str) -> str:
    """Return ', may be the speed' or ', may be the load' for a type 'column in UNIT'; else an empty text."""
    unit = kind.removeprefix('column in ')
    quantities = dict.fromkeys(TURNING_UNITS, 'speed') | dict.fromkeys(LOAD_UNITS, 'load')
    quantity = quantities.get(unit) if unit != kind else None
    return f', may be the {quantity}' if quantity else ''
