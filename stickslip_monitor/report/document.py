# SPDX-License-Identifier: Apache-2.0
"""The content of a report as plain values; the template only lays them out."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Finding:
    """What is said of a bearing, or of everything: a grade, its word, and sentences.

    ``grade`` is ``clear``, ``warning``, ``alarm`` or ``unknown``; the first sentence is the
    verdict, the others add to it.
    """

    grade: str
    word: str
    sentences: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Fact:
    """One figure that matters: its name, its value, and when and where it was."""

    name: str
    value: str
    note: str = ''


@dataclass(frozen=True, slots=True)
class Share:
    """The part of the time spent in a condition or regime."""

    name: str
    key: str
    seconds: str
    percent: float
    text: str


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture as inline SVG: for a wide page, for a narrow one, and what it shows in words."""

    wide: str
    narrow: str
    caption: str


@dataclass(frozen=True, slots=True)
class EventRow:
    """One change of the alarm; ``date`` is empty where it is that of the row above."""

    number: int
    date: str
    time: str
    iso: str
    before: str
    after: str
    grade: str
    text: str


@dataclass(frozen=True, slots=True)
class InputRow:
    """What came of one input: what it is, how much of it there was, and what was wrong."""

    what: str
    topic: str
    field: str
    type: str
    messages: str
    used: str
    span: str
    rate: str
    gaps: str
    faults: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class BearingPart:
    """The report on one bearing in one recording."""

    anchor: str
    name: str
    finding: Finding
    facts: tuple[Fact, ...]
    shares: tuple[Share, ...]
    map: Picture | None
    timeline: Picture | None
    pictures_note: str
    events: tuple[EventRow, ...]
    events_note: str
    inputs: tuple[InputRow, ...]


@dataclass(frozen=True, slots=True)
class TopicRow:
    """A topic of the recording, whether it is an input or not."""

    name: str
    type: str
    messages: str
    problem: str


@dataclass(frozen=True, slots=True)
class BagPart:
    """The report on one recording."""

    anchor: str
    name: str
    path: str
    span: str
    duration: str
    messages: str
    troubles: tuple[str, ...]
    topics: tuple[TopicRow, ...]
    topics_note: str
    bearings: tuple[BearingPart, ...]


@dataclass(frozen=True, slots=True)
class ParameterRow:
    """One parameter in force; ``given`` is false where it is the default."""

    name: str
    value: str
    unit: str
    given: bool


@dataclass(frozen=True, slots=True)
class ParameterGroup:
    """The parameters of the node or of one bearing."""

    title: str
    rows: tuple[ParameterRow, ...]


@dataclass(frozen=True, slots=True)
class Report:
    """The whole report."""

    finding: Finding
    made: str
    version: str
    bags: tuple[BagPart, ...]
    config_path: str
    config_digest: str
    parameters: tuple[ParameterGroup, ...]
    colours: dict[str, tuple[str, str]] = field(default_factory=dict)
