# SPDX-License-Identifier: Apache-2.0
"""Binds each input of a configuration to a topic or column of a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from stickslip_logs.recordings.recording import Recording, TopicInfo, full_topic, missing_topic, short_type
from stickslip_logs.recordings.table_recording import TableRecording
from stickslip_monitor.errors import BagError
from stickslip_monitor.monitor.input_faults import InputFacts, Publisher, input_fault
from stickslip_monitor.monitor.parameters import InputConfig, MonitorConfig
from stickslip_monitor.monitor.sample_types import QUANTITIES
from stickslip_monitor.offline.input_columns import Bound, ColumnBinding

# Unreadable parts that are named at most, where a topic may lie in them.
_MAX_LOSSES_NAMED = 5


def bind(bag: Recording, config: MonitorConfig) -> Bound:
    """Bind every input of a configuration to a topic of a bag or a column of a log.

    A log changes: it is set to deliver the columns, and gets notes on the guesses. A bag stays as it is.

    Returns:
        The configuration with full topic names (for a log also timeouts); by bearing and quantity, why
        an input is absent: its topic is missing, of another type, or cannot be decoded, or in a log no
        column fits it or several do; and for a log the questions on its inputs.
    """
    if isinstance(bag, TableRecording):
        return ColumnBinding(bag).bind(config)
    absent: dict[tuple[str, str], str] = {}
    bearings = []
    for bearing in config.bearings:
        sources: dict[str, Any] = {
            quantity: replace(source, topic=full_topic(source.topic, bag.topics))
            for quantity, source in bearing.inputs.items()
        }
        bearings.append(replace(bearing, **sources))
        for quantity, source in sources.items():
            if text := _absence_text(bag.path, bag.topics, source):
                absent[bearing.name, quantity] = text
    return Bound(replace(config, bearings=tuple(bearings)), absent)


def bind_at_least_one(bag: Recording, config: MonitorConfig) -> Bound:
    """Bind a configuration to a recording as :func:`bind` does, and require one bearing with its inputs.

    Raises:
        BagError: No bearing has both speed and load; the text says why for one of them, and what is lost of
            the bag. Or a damaged bag has nothing that can be read.
    """
    if bag.losses and not bag.topics:
        raise BagError(f"nothing of '{bag.path}' can be read: {'; '.join(bag.losses[:_MAX_LOSSES_NAMED])}")
    bound = bind(bag, config)
    lost = {name for name, quantity in bound.absent if quantity in QUANTITIES}
    if len(lost) == len(bound.config.bearings):
        text = next(text for (_, of), text in bound.absent.items() if of in QUANTITIES)
        # What is missing may lie behind a cut, or in what cannot be read.
        raise BagError('; '.join([text, *bag.losses[:_MAX_LOSSES_NAMED]]))
    return bound


def _absence_text(path: Path, topics: Mapping[str, TopicInfo], source: InputConfig) -> str:
    """Return why a recording lacks an input, without a full stop; '' if it has it."""
    if not source.topic:
        return f"its topic is missing in the configuration: '{path}' has topics, and only a log has columns"
    topic = topics.get(source.topic)
    facts = InputFacts(source.topic, source.type, lost=True)
    if topic is None:
        return f'{input_fault(facts)[:-1]}: {missing_topic(topics, source.topic)}'
    if topic.problem:
        return f"topic '{topic.name}' ({topic.type}) cannot be read: {topic.problem}"
    if short_type(topic.type) != short_type(source.type):
        bags = (Publisher(f"Bag '{path.name}'", topic.type),)
        return input_fault(replace(facts, publishers=bags))[:-1]
    return ''
