# SPDX-License-Identifier: Apache-2.0
"""Blocks loaded while the one before is worked on: decompression needs no interpreter."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor

from .blocks import Block, DamagedBlock, Loaded, load

_WORKERS = 2


def load_ahead(blocks: Sequence[Block]) -> Iterator[Loaded | DamagedBlock]:
    """Load blocks in order, a few at a time.

    Args:
        blocks: What to load.

    Yields:
        Each block, or what is wrong with it.

    Raises:
        BagError: A file cannot be read.
    """
    with ThreadPoolExecutor(_WORKERS) as pool:
        waiting: deque[Future[Loaded | DamagedBlock]] = deque()
        for block in blocks:
            waiting.append(pool.submit(_load, block))
            if len(waiting) > _WORKERS:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def _load(block: Block) -> Loaded | DamagedBlock:
    try:
        return load(block)
    except DamagedBlock as damage:
        return damage
