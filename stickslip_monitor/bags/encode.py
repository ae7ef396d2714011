# SPDX-License-Identifier: Apache-2.0
"""The message types this package writes itself: definition, type hash, and little-endian CDR."""

from __future__ import annotations

import itertools
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stickslip_monitor.errors import BagError

# Message types that are a header and some numbers, with the paths of those.
STAMPED_FIELDS: Mapping[str, tuple[str, ...]] = {
    'geometry_msgs/msg/TwistStamped': tuple(
        f'twist.{part}.{axis}' for part in ('linear', 'angular') for axis in 'xyz'
    ),
    'geometry_msgs/msg/WrenchStamped': tuple(
        f'wrench.{part}.{axis}' for part in ('force', 'torque') for axis in 'xyz'
    ),
}
# All types of which numbers can be written by the column.
NUMBER_FIELDS: Mapping[str, tuple[str, ...]] = {'std_msgs/msg/Float64': ('data',), **STAMPED_FIELDS}
STAMP_END = (1 << 31) * 1_000_000_000
_HEAD = b'\x00\x01\x00\x00'


def encode_float64s(values: ArrayLike) -> list[bytes]:
    """Encode ``std_msgs/Float64`` messages of n numbers."""
    numbers = np.asarray(values, '<f8')
    rows = np.empty(numbers.shape, np.dtype([('head', 'V4'), ('data', '<f8')]))
    rows['head'], rows['data'] = np.void(_HEAD), numbers
    return _items(rows)


def encode_stamped(type_name: str, field: str, stamp_ns: ArrayLike, values: ArrayLike) -> list[bytes]:
    """Encode messages that are a header, with an empty frame, and some numbers.

    Args:
        type_name: The type, one of ``STAMPED_FIELDS``.
        field: Path of the number that is written; the others are zero.
        stamp_ns: Stamps from 1970 to 2038, shape (n,) [ns].
        values: The numbers, shape (n,).

    Raises:
        BagError: A stamp is out of range.
    """
    fields = STAMPED_FIELDS[type_name]
    stamp = np.asarray(stamp_ns, np.int64)
    for beyond in stamp[(stamp < 0) | (stamp >= STAMP_END)][:1].tolist():
        raise BagError(f"stamp {beyond} ns is not between 0 and {STAMP_END} ns, the range of a ROS header's")
    # The empty frame is a length of one and a zero, then comes padding to a multiple of eight.
    layout = [('head', 'V4'), ('sec', '<i4'), ('nanosec', '<u4'), ('frame', '<u8')]
    rows = np.zeros(stamp.size, np.dtype([*layout, ('numbers', '<f8', len(fields))]))
    rows['head'], rows['frame'] = np.void(_HEAD), 1
    rows['sec'], rows['nanosec'] = stamp // 1_000_000_000, stamp % 1_000_000_000
    rows['numbers'][:, fields.index(field)] = values
    return _items(rows)


def _items(rows: NDArray[np.void]) -> list[bytes]:
    items: list[bytes] = rows.view(f'V{rows.itemsize}').tolist()
    return items


def encode_bool(value: bool) -> bytes:
    """Encode one ``std_msgs/Bool`` message."""
    return _HEAD + struct.pack('<?', value)


def encode_string(text: str) -> bytes:
    """Encode one ``std_msgs/String`` message."""
    return _HEAD + _text(text)


def _text(text: str) -> bytes:
    raw = text.encode() + b'\0'
    return struct.pack('<I', len(raw)) + raw


@dataclass(frozen=True, slots=True)
class StatusFields:
    """The fields of a ``diagnostic_msgs/DiagnosticStatus``."""

    level: int
    name: str
    message: str
    hardware_id: str
    values: Mapping[str, str]


def encode_diagnostics(stamp_ns: int, statuses: Sequence[StatusFields]) -> bytes:
    """Encode a ``diagnostic_msgs/DiagnosticArray`` with a stamp [ns] and an empty frame."""
    body = bytearray(struct.pack('<iI', stamp_ns // 1_000_000_000, stamp_ns % 1_000_000_000))

    def put(item: bytes) -> None:
        """Add a number of four bytes, or a text, which begins with one."""
        body.extend(bytes(-len(body) % 4) + item)

    put(_text(''))
    put(struct.pack('<I', len(statuses)))
    for status in statuses:
        body.append(status.level)
        for text in (status.name, status.message, status.hardware_id):
            put(_text(text))
        put(struct.pack('<I', len(status.values)))
        for text in itertools.chain.from_iterable(status.values.items()):
            put(_text(text))
    return _HEAD + bytes(body)


@dataclass(frozen=True, slots=True)
class MessageType:
    """A message type: its ``ros2msg`` text, and its hash (REP 2016), empty when unknown."""

    definition: str
    type_hash: str = ''


_RULE = '=' * 80
_HEADER = f"""{_RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
_VECTOR3 = f"""{_RULE}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""


def _stamped(name: str, first: str, second: str) -> str:
    """Definition of a header and a pair of vectors."""
    return (
        f'std_msgs/Header header\ngeometry_msgs/{name} {name.lower()}\n{_HEADER}'
        f'{_RULE}\nMSG: geometry_msgs/{name}\n'
        f'geometry_msgs/Vector3 {first}\ngeometry_msgs/Vector3 {second}\n{_VECTOR3}'
    )


_DIAGNOSTICS = f"""std_msgs/Header header
diagnostic_msgs/DiagnosticStatus[] status
{_HEADER}{_RULE}
MSG: diagnostic_msgs/DiagnosticStatus
byte OK=0
byte WARN=1
byte ERROR=2
byte STALE=3
byte level
string name
string message
string hardware_id
diagnostic_msgs/KeyValue[] values
{_RULE}
MSG: diagnostic_msgs/KeyValue
string key
string value
"""


MESSAGE_TYPES: Mapping[str, MessageType] = {
    'diagnostic_msgs/msg/DiagnosticArray': MessageType(
        _DIAGNOSTICS, 'RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e'
    ),
    'geometry_msgs/msg/TwistStamped': MessageType(
        _stamped('Twist', 'linear', 'angular'),
        'RIHS01_5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64',
    ),
    'geometry_msgs/msg/WrenchStamped': MessageType(
        _stamped('Wrench', 'force', 'torque'),
        'RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77',
    ),
    'std_msgs/msg/Bool': MessageType(
        'bool data\n', 'RIHS01_feb91e995ff9ebd09c0cb3d2aed18b11077585839fb5db80193b62d74528f6c9'
    ),
    'std_msgs/msg/Float64': MessageType(
        'float64 data\n', 'RIHS01_705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a'
    ),
    'std_msgs/msg/String': MessageType(
        'string data\n', 'RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18'
    ),
}
