# SPDX-License-Identifier: Apache-2.0
"""Which part of a recording an input of a configuration is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from stickslip_monitor.bags.cdr import short_name
from stickslip_monitor.bags.recording import Bound, missing_topic
from stickslip_monitor.bags.values import TopicInfo
from stickslip_monitor.monitor.config import InputConfig, MonitorConfig
from stickslip_monitor.monitor.input_watch import InputFacts, Publisher, input_fault


def bound_to_topics(path: Path, topics: Mapping[str, TopicInfo], config: MonitorConfig) -> Bound:
    """A configuration for a recording of topics: inputs are absent without topic or type."""
    absent = {
        (bearing.name, quantity): text
        for bearing in config.bearings
        for quantity, source in bearing.inputs.items()
        if (text := _absent(path, topics, source))
    }
    return Bound(config, absent)


def _absent(path: Path, topics: Mapping[str, TopicInfo], source: InputConfig) -> str:
    """Why a recording lacks an input, in the words of the running monitor; else empty."""
    topic = topics.get(source.topic)
    facts = InputFacts(source.topic, source.type, source.timeout_ns * 1e-9, lost=True)
    if topic is None:
        return f'{input_fault(facts)[:-1]}: {missing_topic(topics, source.topic)}'
    if short_name(topic.type) != short_name(source.type):
        bags = (Publisher(f"Bag '{path.name}'", topic.type),)
        return input_fault(replace(facts, publishers=bags))[:-1]
    return ''
