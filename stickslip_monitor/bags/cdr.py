# SPDX-License-Identifier: Apache-2.0
"""CDR data of the few message types this package writes itself, little-endian."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import ArrayLike

_HEAD = b'\x00\x01\x00\x00'


def encode_float64s(values: ArrayLike) -> list[bytes]:
    """Encode ``std_msgs/Float64`` messages.

    Args:
        values: The numbers, shape (n,).

    Returns:
        n messages.
    """
    raw = np.asarray(values, '<f8').tobytes()
    return [_HEAD + raw[start : start + 8] for start in range(0, len(raw), 8)]


def encode_float64(value: float) -> bytes:
    """Encode one ``std_msgs/Float64`` message."""
    return _HEAD + struct.pack('<d', value)


def encode_bool(value: bool) -> bytes:
    """Encode one ``std_msgs/Bool`` message."""
    return _HEAD + struct.pack('<?', value)


def encode_string(text: str) -> bytes:
    """Encode one ``std_msgs/String`` message."""
    raw = text.encode() + b'\0'
    return _HEAD + struct.pack('<I', len(raw)) + raw
