# SPDX-License-Identifier: Apache-2.0
"""The topics of a recording, and the checks a request has to pass."""

from __future__ import annotations

import difflib
from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import lru_cache

from mcap.records import Schema

from stickslip_monitor.bags.channels import Meaning
from stickslip_monitor.bags.contents import Part
from stickslip_monitor.bags.decode import FieldReader
from stickslip_monitor.bags.schema import (
    LONGEST_TEXT,
    Definitions,
    SchemaError,
    number_at,
    parse_schema,
    short_name,
)
from stickslip_monitor.bags.values import Request, TopicInfo
from stickslip_monitor.errors import BagError
from stickslip_monitor.fields import FieldPath, parse_field

_MOST_NAMED = 10


def list_topics(parts: Sequence[Part]) -> dict[str, TopicInfo]:
    """List the topics of all parts, by name."""
    members: defaultdict[str, list[tuple[Meaning, int]]] = defaultdict(list)
    for part in parts:
        for meaning in part.channels:
            count = meaning.count if part.stated is None else part.stated[meaning.channel.id]
            members[meaning.channel.topic].append((meaning, count))
    return {name: _topic(name, members[name]) for name in sorted(members)}


def _topic(name: str, members: Sequence[tuple[Meaning, int]]) -> TopicInfo:
    known = [meaning for meaning, _ in members if not meaning.is_refused]
    types = list(dict.fromkeys(meaning.type for meaning in known))
    problems = [meaning.problem for meaning in known if meaning.problem]
    if len(types) > 1:
        problems.append(f'it has several types: {", ".join(types)}')
    count = sum(count for _, count in members)
    encoding = known[0].channel.message_encoding
    return TopicInfo(name, types[0], count, encoding, problems[0] if problems else '')


@lru_cache(maxsize=256)
def _definitions(name: str, data: bytes) -> Definitions:
    if len(data) > LONGEST_TEXT:
        raise SchemaError(f'its definition is longer than {LONGEST_TEXT} letters, the limit')
    try:
        return parse_schema(name, data.decode())
    except UnicodeDecodeError:
        raise SchemaError('its definition is not text') from None


def check_topics(topics: Mapping[str, TopicInfo], names: Iterable[str]) -> None:
    """Raise BagError for a topic that is not in the recording."""
    for name in names:
        if name not in topics:
            raise BagError(missing_topic(topics, name))


def missing_topic(topics: Collection[str], name: str) -> str:
    """What there is to say of a topic that is not there: those that are, the nearest first."""
    close = difflib.get_close_matches(name, topics, _MOST_NAMED, cutoff=0.5)
    ranked = [*close, *(topic for topic in topics if topic not in close)]
    return f"topic '{name}' is not in the bag: {_listed(ranked)}"


def _listed(names: Sequence[str]) -> str:
    if not names:
        return 'it has no topics'
    more = len(names) - _MOST_NAMED
    rest = f' and {more} more' if more > 0 else ''
    return f'it has {", ".join(names[:_MOST_NAMED])}{rest}'


def check_request(topics: Mapping[str, TopicInfo], request: Request) -> FieldPath:
    """Check a request against the topics of a recording.

    Args:
        topics: The topics.
        request: What is asked for.

    Returns:
        The path to the number.

    Raises:
        BagError: The topic is not there, cannot be decoded, or has another type.
        ConfigurationError: The field is not a path.
    """
    path = parse_field(request.field)
    check_topics(topics, [request.topic])
    topic = topics[request.topic]
    if not topic.readable:
        raise BagError(f"topic '{topic.name}' ({topic.type}) cannot be read: {topic.problem}")
    if request.type is not None and short_name(request.type) != short_name(topic.type):
        raise BagError(
            f"topic '{topic.name}' has type {topic.type} in the bag, not {request.type}"
        )
    return path


def make_plan(topic: str, schema: Schema, paths: Sequence[FieldPath]) -> FieldReader:
    """Make the plan to read numbers of a topic.

    Args:
        topic: Its name.
        schema: The definition of its messages.
        paths: Paths to the numbers.

    Returns:
        The plan.

    Raises:
        BagError: A path does not lead to a number, or the definition is unusable.
    """
    try:
        definitions = _definitions(schema.name, schema.data)
    except SchemaError as error:
        raise BagError(f"topic '{topic}' ({schema.name}) cannot be read: {error}") from None
    for path in paths:
        try:
            number_at(definitions, schema.name, path)
        except SchemaError as error:
            shown = _shown(path)
            raise BagError(
                f"field '{shown}' of topic '{topic}' ({schema.name}) is no number: {error}"
            ) from None
    try:
        return FieldReader(schema, definitions, paths)
    except SchemaError as error:
        raise BagError(f"topic '{topic}' ({schema.name}) cannot be read: {error}") from None


def _shown(path: FieldPath) -> str:
    return ''.join(f'[{s}]' if isinstance(s, int) else f'.{s}' for s in path).removeprefix('.')
