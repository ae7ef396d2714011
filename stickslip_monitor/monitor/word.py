# SPDX-License-Identifier: Apache-2.0
"""Words that the monitor speaks in: names with the sentence that explains each."""

from __future__ import annotations

from enum import Enum
from typing import TypeVar

_Word = TypeVar('_Word', bound='Word')


class Word(str, Enum):
    """A name; each member carries its sentence."""

    sentence: str

    def __new__(cls: type[_Word], name: str, sentence: str) -> _Word:
        """Make a member from its name and its sentence."""
        member = str.__new__(cls, name)
        member._value_ = name
        member.sentence = sentence
        return member

    def __str__(self) -> str:
        return str(self.value)
