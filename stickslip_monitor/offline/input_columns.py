# SPDX-License-Identifier: Apache-2.0
"""Which column of a log an input of a configuration is, and what its numbers are."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from stickslip_logs.recordings.columns import FLOAT64, LogColumn, SourceColumn
from stickslip_logs.recordings.table_recording import TableRecording, listed
from stickslip_logs.tables.dialect import parse_heading, unit_of
from stickslip_monitor.errors import BagError, did_you_mean
from stickslip_monitor.monitor.parameters import (
    LOAD_UNITS,
    BearingConfig,
    InputConfig,
    MonitorConfig,
    SpeedConfig,
)
from stickslip_monitor.monitor.signals import NO_VALUES
from stickslip_monitor.physics.bearing import TURNING_UNITS

# A value counts for so many intervals, as a lost line is no lost input.
_TIMEOUT_LINES = 3.0
# Reports of each hour or noon have a value so many seconds apart, or more: a coast-down takes minutes [s].
_SLOWEST = 1800.0
# Of ten years, to which any time of a log can be added [ns].
_LONGEST_NS = 10 * 31_557_600 * 10**9
# A column is taken by its unit only if its heading has one of these words, or is a unit, and no others than
# these, those of its bearing and topic, and numbers: what else has the unit is named by its owner.
_HEADINGS = {
    'speed': {
        *('speed', 'rpm', 'shaftrpm', 'revolutions', 'revolution', 'revs', 'n', 'drehzahl', 'wellendrehzahl'),
        *('propellerdrehzahl', 'rotational', 'rotation', 'shaft', 'propeller', 'welle'),
    },
    'load': {'load', 'force', 'f', 'bearing', 'brg', 'lagerkraft', 'lagerlast', 'last', 'kraft'},
}
_BESIDE = {
    *('prop', 'lager', 'sensor', 'measured', 'actual', 'value'),
    *('mean', 'avg', 'average', 'of', 'the'),
}
# 'RPM S 01' is 'RPM S 1'.
_ZEROS = re.compile(r'\b0+(?=\d)')
# Words of one side or end of a ship, and of the other.
_SIDES = (
    ({'port', 'ps', 'bb', 'backbord', 'babord'}, {'starboard', 'stbd', 'sb', 'stb', 'steuerbord', 'tribord'}),
    ({'aft', 'after', 'achtern', 'hinten'}, {'forward', 'fwd', 'fore', 'vorn'}),
)
# How local IDs of ISO 19848 name a quantity; they have no units.
_LOCAL_IDS = {'speed': '/meta/qty-rotational.frequency', 'load': '/meta/qty-force'}


@dataclass(frozen=True, slots=True)
class Bound:
    """A configuration as it holds for one recording.

    Attributes:
        config: The configuration, with the topics and the timeouts that hold for the recording.
        absent: Why an input is not in the recording, by bearing and quantity.
        questions: What is to be asked about an input, likewise: clauses that follow its name.
    """

    config: MonitorConfig
    absent: Mapping[tuple[str, str], str] = field(default_factory=dict)
    questions: Mapping[tuple[str, str], str] = field(default_factory=dict)


class ColumnBinding:
    """Finds the columns of a log that are the inputs of a configuration.

    Attributes:
        columns: By the topic that each stands for.
        said: What was guessed.
        asked: What is to be asked, by bearing and quantity.
    """

    def __init__(self, log: TableRecording) -> None:
        self._log, self._path, self._all = log, log.path, log.all_columns
        self.columns: dict[str, SourceColumn] = {}
        self.said: list[str] = []
        self.asked: dict[tuple[str, str], str] = {}
        self._asked_clocks: set[tuple[int, ...]] = set()

    def bind(self, config: MonitorConfig) -> Bound:
        """Return the configuration with the topics and timeouts that hold for the table."""
        absent: dict[tuple[str, str], str] = {}
        changed: dict[str, dict[str, Any]] = {}
        wanted = [
            (b, *bearing_config)
            for b in config.bearings
            for bearing_config in b.inputs.items()
            if not bearing_config[1].is_assumed
        ]
        bindings: list[tuple[BearingConfig, str, InputConfig, LogColumn]] = []
        for bearing, quantity, source in wanted:
            try:
                column = self._rows_of(
                    bearing, quantity, source, self._find_column(bearing, quantity, source)
                )
                bindings.append((bearing, quantity, source, column))
            except BagError as error:
                absent[bearing.name, quantity] = str(error)
        for bearing, quantity, source, column in bindings:
            topics = {binding.topic for _, of, binding, same in bindings if (of, same) == (quantity, column)}
            if (
                len(topics) > 1
                and not source.column
                and not _is_named_after(column, bearing.name, source.topic)
            ):
                absent[bearing.name, quantity] = (
                    f"log '{self._path}': column '{column.heading}' is the {quantity} of one bearing, and"
                    f' {len(topics)} have different topics: write {bearing.name}.{quantity}.column'
                )
                continue
            every = self._log.interval(column)
            binding = self._bind_column(bearing, quantity, source, column, every)
            changed.setdefault(bearing.name, {})[quantity] = binding
        for bearing_config in config.bearings:
            inputs = changed.get(bearing_config.name, {})
            if bearing_config.load.is_assumed and 'speed' in inputs:
                # It comes with the speed.
                names = ('topic', 'type', 'field_text', 'field', 'timeout_ns', 'hold_ns')
                inputs['load'] = replace(
                    bearing_config.load, **{k: getattr(inputs['speed'], k) for k in names}
                )
        bearings = tuple(replace(b, **changed.get(b.name, {})) for b in config.bearings)
        return Bound(replace(config, bearings=bearings), absent, self.asked)

    def _find_column(self, bearing: BearingConfig, quantity: str, source: InputConfig) -> LogColumn:
        """Return the one column that is an input.

        Raises:
            BagError: None is, or several may be.
        """
        columns = list(self._find_candidates(bearing.name, quantity, source))
        if len(columns) > 1:
            # Another sender of a number stands in for the first.
            columns = [c for c in columns if not c.is_other] or columns
            named = [c for c in columns if _is_named_after(c, bearing.name)]
            columns = named if len(named) == 1 else columns
        if len(columns) == 1:
            return columns[0]
        parameter = f'{bearing.name}.{quantity}.column'
        if columns:
            # Of columns of one heading only the place tells.
            is_one = len({column.heading for column in columns}) == 1
            names = [f'#{column.place + 1}' if is_one else column.heading for column in columns]
            raise BagError(
                f"log '{self._path}': {len(columns)} columns may be the {quantity}: {listed(names)};"
                f' write {parameter}'
            )
        counts = Counter(column.heading for column in self._all)
        headings = [c.heading if counts[c.heading] == 1 else f'#{c.place + 1}' for c in self._all]
        if source.column:
            near = did_you_mean(source.column, headings)
            raise BagError(
                f"log '{self._path}' has no column '{source.column}' ({parameter}): it has"
                f' {listed(headings)}{near}'
            )
        example = next(
            (f"{parameter}: '{name}' or another" for name in headings if name[:1] == '#'), parameter
        )
        remedy = f', or {bearing.name}.load.constant or .over_speed' if quantity == 'load' else ''
        raise BagError(
            f"log '{self._path}': no column is to be known as the {quantity} of {bearing.name} by"
            f' its unit or its name: it has {listed(headings)}; write {example}{remedy}'
        )

    def _rows_of(
        self, bearing: BearingConfig, quantity: str, source: InputConfig, column: LogColumn
    ) -> LogColumn:
        """Return the column with the rows that count.

        Raises:
            BagError: Its rows are of several things, or those that are chosen are not there.
        """
        column = self._log.chosen(column, source.where_texts)
        if (key := self._log.key_of(column)) is None:
            return column
        heading, texts = key
        others = ''.join(f', {name}: {text}' for name, text in source.where_texts.items())
        raise BagError(
            f"log '{self._path}': the lines of '{column.heading}' are of several things, told apart by column"
            f" '{heading}' ({listed(texts)}): write {bearing.name}.{quantity}.where:"
            f' {{{heading}: {texts[0]}{others}}}, and a bearing for each'
        )

    def _find_candidates(self, bearing: str, quantity: str, source: InputConfig) -> Sequence[LogColumn]:
        """Return the columns that may be an input, by the first rule that fits any."""
        if source.column:
            wanted = _ZEROS.sub('', parse_heading(source.column).name)
            same = [c for c in self._all if c.heading == source.column]
            similar = [
                c for c in self._all if wanted and _ZEROS.sub('', parse_heading(c.heading).name) == wanted
            ]
            # Of a log of names by the place of its values all rows.
            number = [
                c if c.name is None else LogColumn(source.column, c.place)
                for c in self._all
                if f'#{c.place + 1}' == source.column
            ]
            return same or similar or number[:1]
        topic = source.topic.strip('/')
        names = {parse_heading(topic).name, parse_heading(topic.rpartition('/')[2]).name}
        own_names = {quantity, parse_heading(f'{bearing} {quantity}').name}
        units = _units_of(quantity, source)
        # One that says another unit is another quantity: 'Speed (kn)' is the ship's own.
        candidates = [c for c in self._all if c.unit in units or not c.has_unit]
        # PlotJuggler writes the field behind the topic.
        of_topic = [
            c for c in candidates if topic and c.heading.strip('/') in (topic, f'{topic}/{source.field_text}')
        ]
        # The bearing may be that of a thruster.
        called = {*parse_heading(f'{bearing} {topic.replace("/", " ")}').name.split()}
        foreign_words = set[str]()
        for one, other_side in (*_SIDES, *(pair[::-1] for pair in _SIDES)):
            called |= one if called & one else set()
            foreign_words |= other_side if called & one and not called & other_side else set()
        candidates = [c for c in candidates if not foreign_words & {*parse_heading(c.heading).name.split()}]
        plain = [parse_heading(c.heading).name for c in candidates]
        similar = [c for c, name in zip(candidates, plain, strict=True) if name in names - {quantity}]
        by_unit = [
            c for c in candidates if c.unit in units and (self._log.is_sent or _is_plain(c, quantity, called))
        ]
        local = _LOCAL_IDS.get(quantity, '\0')
        by_name = [
            c for c, name in zip(candidates, plain, strict=True) if name in own_names or local in c.heading
        ]
        return of_topic or similar or by_unit or by_name

    def _bind_column(
        self, bearing: BearingConfig, quantity: str, source: InputConfig, column: LogColumn, every: float
    ) -> InputConfig:
        """Return an input as the table gives it, and note what was guessed."""
        unit = column.unit if column.unit in _units_of(quantity, source) else None
        # What came over a bus is what the sensor sent, and what is written beside a named column is meant.
        is_scaled = unit is not None and not (self._log.is_sent or source.column)
        sent = SourceColumn(column)
        if unit is not None:
            ratio = _unit_factor(bearing, quantity, unit) / _unit_factor(bearing, quantity, source.unit)
            ratio = 1.0 if unit == source.unit else ratio
            scaled = (source.scale, source.offset) if is_scaled else (1.0, 0.0)
            sent = SourceColumn(column, ratio, *scaled, kept=NO_VALUES)
        timeout_ns = max(min(round(_TIMEOUT_LINES * every * 1e9), _LONGEST_NS), source.timeout_ns)
        sent = replace(sent, timeout=timeout_ns * 1e-9 if self._log.is_sent else None)
        topic = source.topic
        if not topic or self.columns.get(topic, sent) != sent:
            topic = f'/{bearing.name}/{quantity}'
        self.columns[topic] = sent
        why = 'by its heading' if unit else f'as {bearing.name}.{quantity}.unit says'
        remark = f"{quantity} of {bearing.name} is column '{column.heading}' in {unit or source.unit}, {why}"
        if unit is None and column.has_unit:
            stated = column.unit or parse_heading(column.heading).unit
            if stated is None or stated.strip('\u00b0 ').upper() != source.unit.upper():
                clause = f"is column '{column.heading}' in {source.unit}, and its heading says '{stated}'"
                self._add_question(bearing, quantity, f'{clause}: is that right?')
        if (source.scale, source.offset) != (1.0, 0.0):
            remark += ', taken as scaled already' if is_scaled else f', times its scale {source.scale:g}'
            if is_scaled:
                self._add_question(
                    bearing,
                    quantity,
                    f"is column '{column.heading}' in {unit} by its heading, so its scale {source.scale:g}"
                    f' and offset {source.offset:g} are not applied: write'
                    f' {bearing.name}.{quantity}.column: "{column.heading}" if they are to be',
                )
            remark += f' and with its offset {source.offset:g}' if source.offset and not is_scaled else ''
        elif isinstance(source, SpeedConfig) and source.gear_text:
            remark += f', {source.gear_text}'
        elif quantity == 'speed' and not (source.column or _is_plain(column, quantity, {'s'})):
            self._add_question(
                bearing,
                quantity,
                f"is column '{column.heading}': is it the shaft's own? Write"
                f' {bearing.name}.{quantity}.column, and gear where one is between',
            )
        self._ask_of_times(bearing, quantity, source, column, every)
        if timeout_ns > source.timeout_ns:
            remark += f'; lines are {every:.4g} s apart, so its timeout is {timeout_ns * 1e-9:.4g} s here'
        self.said.append(remark)
        return replace(
            source, topic=topic, type=FLOAT64, field_text='data', field=('data',), timeout_ns=timeout_ns
        )

    def _add_question(self, bearing: BearingConfig, quantity: str, clause: str) -> None:
        """Note a clause that is asked of an input, behind those that are."""
        earlier = self.asked.get((bearing.name, quantity))
        self.asked[bearing.name, quantity] = f'{earlier}; and {clause}' if earlier else clause

    def _ask_of_times(
        self, bearing: BearingConfig, quantity: str, source: InputConfig, column: LogColumn, every: float
    ) -> None:
        """Ask of an input what its times do not tell, of each clock of the log once."""
        clock = self._log.table.clock_of(column.place)
        if clock.question and clock.columns not in self._asked_clocks:
            self._asked_clocks.add(clock.columns)
            self._add_question(bearing, quantity, clock.question)
        filler = self._log.filler(column)
        if filler is not None and filler not in NO_VALUES:
            clause = (
                f'has {filler:g} far from all other values: leave these cells empty if it means that there is'
            )
            self._add_question(bearing, quantity, f'{clause} no value')
        if every > _SLOWEST and not source.hold_ns:
            clause = f'has a value each {every:.4g} s, which cannot judge what a shaft does in minutes: is'
            self._add_question(bearing, quantity, f'{clause} there a log with one each 10 s or less?')


def _is_named_after(column: LogColumn, bearing: str, topic: str = '') -> bool:
    """Return whether a heading names a bearing, or is a topic."""
    is_topic = bool(topic) and column.heading.strip('/').startswith(topic.strip('/'))
    return is_topic or {*bearing.split('_')} <= {*parse_heading(column.heading).name.split()}


def _is_plain(column: LogColumn, quantity: str, called: set[str]) -> bool:
    """Return whether a heading says the quantity, or is a unit, and nothing else but some words."""
    words = {word for word in parse_heading(column.heading).name.split() if not word.isdecimal()}
    unit = {*parse_heading(parse_heading(column.heading).unit or '').name.split()}
    unit |= {word for word in words if unit_of(word, 'force')}
    own = _HEADINGS.get(quantity, set())
    return bool(words & own or words <= unit) and words <= own | _BESIDE | called | unit


def _units_of(quantity: str, source: InputConfig) -> tuple[str, ...]:
    """Return the units by which a column is known to be a quantity."""
    if quantity == 'speed':
        # A column in m/s may be the ship's own speed.
        return (*TURNING_UNITS, *(['m/s'] if source.unit == 'm/s' else []))
    return tuple(LOAD_UNITS) if quantity == 'load' else (source.unit,)


def _unit_factor(bearing: BearingConfig, quantity: str, unit: str) -> float:
    """Return what a unit is in SI."""
    if quantity == 'speed':
        return bearing.bearing.speed.factor(unit)
    return LOAD_UNITS[unit] if quantity == 'load' else 1.0


def guess_of(kind: str) -> str:
    """Return ', may be the speed' or ', may be the load' for a type 'column in UNIT'; else an empty text."""
    unit = kind.removeprefix('column in ')
    quantities = dict.fromkeys(TURNING_UNITS, 'speed') | dict.fromkeys(LOAD_UNITS, 'load')
    quantity = quantities.get(unit) if unit != kind else None
    return f', may be the {quantity}' if quantity else ''
