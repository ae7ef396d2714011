# SPDX-License-Identifier: Apache-2.0
"""Chunk decompression that trusts no length it has not seen, whole and cut chunks alike."""

from __future__ import annotations

from collections.abc import Callable

import lz4.frame  # type: ignore[import-untyped]
import zstandard

# A cut chunk is fed in small pieces, so that an error inside costs only what follows it.
_PIECE = 4096


class CompressionError(Exception):
    """The data cannot be decompressed; the text is a clause for a sentence."""


def decompress(data: bytes, compression: str, size: int) -> bytes:
    """Decompress a whole chunk.

    Args:
        data: Compressed bytes.
        compression: Name used by MCAP: ``''``, ``'lz4'`` or ``'zstd'``.
        size: Decompressed size the chunk declares [bytes].

    Returns:
        Exactly ``size`` bytes.

    Raises:
        CompressionError: Unknown compression, damaged data, or another size than declared.
    """
    try:
        plain = _WHOLE[compression](data, size)
    except KeyError:
        raise CompressionError(f"its compression '{compression}' is unknown") from None
    except (zstandard.ZstdError, RuntimeError, MemoryError, EOFError):
        raise CompressionError(f'its {compression} data does not decompress') from None
    if len(plain) != size:
        raise CompressionError(f'it holds {len(plain)} bytes where it declares {size}')
    return plain


def decompress_prefix(data: bytes, compression: str, size: int) -> bytes:
    """Decompress as much as the beginning of a chunk gives.

    Args:
        data: The compressed bytes that are there, perhaps none.
        compression: As for :func:`decompress`.
        size: Decompressed size the chunk declares, a bound on the result [bytes].

    Returns:
        The bytes that could be restored; empty when the compression is unknown.
    """
    if not compression:
        return data[:size]
    if compression not in _PIECEWISE:
        return b''
    feed = _PIECEWISE[compression]()
    parts: list[bytes] = []
    total = 0
    try:
        for start in range(0, len(data), _PIECE):
            parts.append(feed(data[start : start + _PIECE]))
            total += len(parts[-1])
            if total >= size:
                break
    except (zstandard.ZstdError, RuntimeError, MemoryError, EOFError):
        pass
    return b''.join(parts)[:size]


def _plain(data: bytes, size: int) -> bytes:
    return data


def _zstd(data: bytes, size: int) -> bytes:
    if zstandard.frame_content_size(data) == size:
        return zstandard.ZstdDecompressor().decompress(data)
    # Without a matching size in the frame the declared one may be garbage: let the output grow.
    return decompress_prefix(data, 'zstd', size)


def _lz4(data: bytes, size: int) -> bytes:
    plain: bytes = lz4.frame.decompress(data)
    return plain


def _zstd_feed() -> Callable[[bytes], bytes]:
    return zstandard.ZstdDecompressor().decompressobj().decompress


def _lz4_feed() -> Callable[[bytes], bytes]:
    feed: Callable[[bytes], bytes] = lz4.frame.LZ4FrameDecompressor().decompress
    return feed


_WHOLE: dict[str, Callable[[bytes, int], bytes]] = {'': _plain, 'zstd': _zstd, 'lz4': _lz4}
_PIECEWISE: dict[str, Callable[[], Callable[[bytes], bytes]]] = {
    'zstd': _zstd_feed,
    'lz4': _lz4_feed,
}
