# SPDX-License-Identifier: Apache-2.0
"""Where numbers lie in CDR data, found for many messages at once.

A message is a row of tokens.  A cursor steps over them: one number for all messages while nothing
of variable length was met, an array of one per message behind it.
"""

from __future__ import annotations

import enum
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import BoolArray, IntArray
from stickslip_monitor.bags.mcap_records import view
from stickslip_monitor.bags.schema import NUMBERS, TEXTS, Definitions, short_name
from stickslip_monitor.fields import FieldPath

# Beyond this a message is no telemetry, and its tokens would cost more than they save.
_MOST_TOKENS = 500

# A type that contains itself has no end.
_DEEPEST = 50

# Longer texts are left to the decoder: they are checked eight bytes at a time.
_LONGEST_TEXT = 256

_NOT_ASCII = np.uint64(0x8080808080808080)


class TokenKind(enum.Enum):
    """What a token is."""

    NUMBERS = 'numbers'
    SEQUENCE = 'sequence of numbers'
    TEXT = 'text'


@dataclass(frozen=True, slots=True)
class Token:
    """A stretch of CDR data: ``count`` numbers of numpy type ``code``, a sequence, or a text."""

    kind: TokenKind
    code: str = 'u1'
    count: int = 1

    @property
    def item_size(self) -> int:
        """Bytes of one number, which is also its alignment."""
        return np.dtype(self.code).itemsize


@dataclass(frozen=True, slots=True)
class Layout:
    """Tokens of a message and, for each number wanted, its token and its place in it."""

    tokens: tuple[Token, ...]
    targets: tuple[tuple[int, int], ...]


def compile_layout(
    definitions: Definitions, root: str, paths: Sequence[FieldPath]
) -> Layout | None:
    """Compile the layout of a type for some of its numbers.

    Args:
        definitions: Definitions of the type and those it uses.
        root: The type.
        paths: Paths that lead to numbers.

    Returns:
        The layout; None for a type whose messages must be decoded one by one.
    """
    tokens: list[Token] = []
    numbers: dict[FieldPath, int] = {}
    for path, token in _tokens(definitions, short_name(root), ()):
        if token is None or len(tokens) >= _MOST_TOKENS:
            return None
        numbers[path] = len(tokens)
        tokens.append(token)
    return Layout(tuple(tokens), tuple(_target(numbers, path) for path in paths))


def _target(numbers: dict[FieldPath, int], path: FieldPath) -> tuple[int, int]:
    element = path[-1]
    return (numbers[path[:-1]], element) if isinstance(element, int) else (numbers[path], 0)


def _tokens(
    definitions: Definitions, root: str, prefix: FieldPath
) -> Iterator[tuple[FieldPath, Token | None]]:
    """List the tokens of a type with their paths; None for what has no layout."""
    if len(prefix) > _DEEPEST:
        yield prefix, None
        return
    if not definitions[root]:
        # CDR has no empty structure; ROS 2 gives it one unused byte.
        yield (*prefix, ''), Token(TokenKind.NUMBERS)
    for member in definitions[root]:
        path = (*prefix, member.name)
        if member.base in NUMBERS:
            kind = (
                TokenKind.SEQUENCE
                if member.is_array and member.size is None
                else TokenKind.NUMBERS
            )
            count = member.size if member.size is not None else 1
            yield path, Token(kind, NUMBERS[member.base], count)
        elif member.base == 'wstring' or (member.is_array and member.size is None):
            yield path, None
        elif member.base in TEXTS:
            for _ in range(1 if member.size is None else member.size):
                yield path, Token(TokenKind.TEXT)
        elif member.size is None:
            yield from _tokens(definitions, member.base, path)
        else:
            for index in range(member.size):
                yield from _tokens(definitions, member.base, (*path, index))


@dataclass(slots=True)
class Gather:
    """Numbers gathered from messages in one byte order.

    ``base`` is where each message's CDR data begins in ``data`` (behind its encapsulation head),
    ``size`` how long it is.  ``sound`` becomes False for messages that have anything unusual:
    only the decoder can tell what they hold.
    """

    data: bytes
    base: IntArray
    size: IntArray
    big_endian: bool
    sound: BoolArray = field(init=False)

    def __post_init__(self) -> None:
        """Begin with every message sound."""
        self.sound = np.ones(len(self.base), np.bool_)

    def run(self, layout: Layout) -> list[NDArray[Any]]:
        """Step through all messages.

        Args:
            layout: Their layout.

        Returns:
            One array per target, meaningful where ``sound``.
        """
        found: dict[tuple[int, int], NDArray[Any]] = {}
        place: int | IntArray = 0
        for number, token in enumerate(layout.tokens):
            begin, place, length = self._enter(token, place)
            for target in layout.targets:
                if target[0] == number:
                    self.sound &= target[1] < length
                    spot = begin + target[1] * token.item_size
                    found[target] = self._fetch(token.code, spot)
            end = begin + length * token.item_size
            # Nothing is aligned for the items of a sequence that has none.
            place = np.where(length > 0, end, place) if token.kind is TokenKind.SEQUENCE else end
        self.sound &= place <= self.size
        return [found[target] for target in layout.targets]

    def _enter(
        self, token: Token, place: int | IntArray
    ) -> tuple[int | IntArray, int | IntArray, int | IntArray]:
        """Find the first item of a token, the end of its length field, and how many items."""
        if token.kind is TokenKind.NUMBERS:
            begin = _align(place, token.item_size)
            return begin, begin, token.count
        place = _align(place, 4)
        length = self._fetch('u4', place).astype(np.int64)
        place = place + 4
        if token.kind is TokenKind.TEXT:
            self._check_text(place, length)
        return _align(place, token.item_size), place, length

    def _fetch(self, code: str, place: int | IntArray) -> NDArray[Any]:
        # A byte that is neither 0 nor 1 is still a bool, but not one numpy can hold.
        stored = 'u1' if code == '?' else code
        numbers = view(self.data, f'{">" if self.big_endian else "<"}{stored}')
        self.sound &= place + numbers.itemsize <= self.size
        spot = self.base + place
        if not self.sound.all():
            spot = np.where(self.sound, spot, 0)
        found: NDArray[Any] = numbers[spot]
        return np.not_equal(found, 0) if code == '?' else found

    def _check_text(self, place: int | IntArray, length: IntArray) -> None:
        """Leave text that is not ASCII to the decoder: it may not be valid UTF-8."""
        self.sound &= (length <= _LONGEST_TEXT) & (place + length <= self.size)
        words = view(self.data, '<u8')
        longest = int(length[self.sound].max(initial=0))
        for done in range(0, longest, 8):
            spot = self.base + place + done
            rest = np.clip(length - done, 0, 8)
            self.sound &= (rest == 0) | (spot < len(words))
            text = words[np.where(self.sound & (rest > 0), spot, 0)]
            unused = (8 * (8 - rest)).astype(np.uint64)
            high = (text << np.minimum(unused, np.uint64(63))) & _NOT_ASCII
            self.sound &= (rest == 0) | (high == 0)


def _align(place: int | IntArray, size: int) -> int | IntArray:
    return (place + size - 1) // size * size if size > 1 else place
