# SPDX-License-Identifier: Apache-2.0
"""The ``metadata.yaml`` of a rosbag2 folder, read and written."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import yaml

from stickslip_monitor.errors import BagError
from stickslip_monitor.files import read_file

FILE_NAME = 'metadata.yaml'

_ROOT = 'rosbag2_bagfile_information'
# Ten thousand topics or files [bytes].
_LARGEST = 8 << 20
_DEEPEST = 30
_LOADER = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)

_NOT_METADATA = (
    yaml.YAMLError, LookupError, TypeError, ValueError, AttributeError, OverflowError,
    RecursionError,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Metadata:
    """What the reader needs of ``metadata.yaml``: files, and how many messages they hold."""

    files: tuple[str, ...]
    message_count: int


@dataclass(slots=True)
class TopicEntry:
    """One topic as the writer lists it, with the number of its channel."""

    name: str
    type: str
    type_hash: str
    channel: int
    count: int = 0


def read_metadata(folder: Path) -> Metadata | str:
    """Read a folder's metadata.

    Args:
        folder: A rosbag2 folder.

    Returns:
        The metadata, or a sentence saying why it cannot be used.

    Raises:
        BagError: It describes a recording of a kind this package cannot read.
    """
    path = folder / FILE_NAME
    try:
        information = _load(read_file(path, _LARGEST))[_ROOT]
        _check_kind(folder, information)
        names = dict.fromkeys(PurePosixPath(n).name for n in information['relative_file_paths'])
        return Metadata(tuple(names), int(information['message_count']))
    except FileNotFoundError:
        return f"folder '{folder}' has no {FILE_NAME}"
    except OSError as error:
        return f"'{path}' cannot be read: {error.strerror}"
    except _NOT_METADATA:
        return f"'{path}' is not rosbag2 metadata"


def _load(data: bytes) -> Any:
    """YAML without aliases, which rosbag2 does not write, and without much nesting."""
    depth = 0
    for event in yaml.parse(data, _LOADER):
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > _DEEPEST or isinstance(event, yaml.AliasEvent):
            raise ValueError('no metadata has this')
    return yaml.load(data, _LOADER)


def _check_kind(folder: Path, information: Mapping[str, Any]) -> None:
    storage = information.get('storage_identifier', 'mcap')
    if storage != 'mcap':
        raise BagError(
            f"bag '{folder}' is stored as '{storage}', not mcap: convert it with"
            " 'ros2 bag convert' first"
        )
    mode = str(information.get('compression_mode') or 'none').lower()
    if mode in ('file', 'message'):
        raise BagError(
            f"bag '{folder}' has compression_mode '{mode}', but only the compression inside MCAP"
            " can be read: convert it with 'ros2 bag convert' first"
        )


def render_metadata(
    file_name: str, start_ns: int, end_ns: int, topics: Collection[TopicEntry]
) -> str:
    """Render the metadata of a recording that is one file.

    Args:
        file_name: Name of the file inside the folder.
        start_ns: Earliest log time [ns].
        end_ns: Latest log time [ns].
        topics: The topics in the order they were added.

    Returns:
        The YAML text, in rosbag2's format of version 9.
    """
    count = sum(topic.count for topic in topics)
    span = {
        'starting_time': {'nanoseconds_since_epoch': start_ns},
        'duration': {'nanoseconds': end_ns - start_ns},
        'message_count': count,
    }
    information = {
        'version': 9,
        'storage_identifier': 'mcap',
        **span,
        'topics_with_message_count': [_topic(topic) for topic in topics],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [file_name],
        'files': [{'path': file_name, **_copy(span)}],
        'custom_data': None,
        'ros_distro': 'unknown',
    }
    return yaml.safe_dump({_ROOT: information}, sort_keys=False)


def _topic(topic: TopicEntry) -> dict[str, Any]:
    description = {
        'name': topic.name,
        'type': topic.type,
        'serialization_format': 'cdr',
        'offered_qos_profiles': [],
        'type_description_hash': topic.type_hash,
    }
    return {'topic_metadata': description, 'message_count': topic.count}


def _copy(span: Mapping[str, Any]) -> dict[str, Any]:
    # The same object twice would become a YAML alias, which rosbag2's reader need not know.
    return {key: dict(value) if isinstance(value, dict) else value for key, value in span.items()}
