# SPDX-License-Identifier: Apache-2.0
"""Columns that say of the numbers of another whether they count, by words and by the codes of OPC.

OPC DA (Data Access 3.00, section 6.8): the two highest bits of the low byte are 11 for good, so 192 and more.
OPC UA (Part 4, section 7.39): the two highest of 32 bits are the severity, 00 for good. Flags of quality
control (QARTOD, Argo): 3 is suspect, 4 is bad, 9 is missing.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable

from stickslip_logs.tables.dialect import parse_heading

_HEADING = re.compile(r'q|qc|qf|good|(?:opc)?(?:status(?:code)?|qual|quality\w*|valid|validity)')
# What may stand beside them, and beside the name of what they are of.
_BESIDE = {'code', 'flag', 'value', 'val', 'wert'}
# Beside a word of the first kind any other is bad; without one, as among states of an engine, these are.
_GOOD = re.compile(r'\s*(?:good|ok|valid|true)', re.I)
_BAD = re.compile(
    r'\s*(?:0x|bad|invalid|uncertain|false|fail|fault|err|stale|not (?!run|ready)|comm|timeout)', re.I
)
_CODE = re.compile(r'\s*(0x[0-9a-f]+|[-+]?\d+)(?:\.0*)?(?![\w.])', re.I)
_MAX_DA, _GOOD_DA, _BITS_UA = 0xFFFF, 0xC0, 30
_BAD_FLAGS = 3, 4, 9


def is_quality_of(heading: str, other: str, *, is_beside: bool) -> bool:
    """Return whether a column is named as the quality of another, or as a quality beside it.

    Beside it the other's name may have more words, as ``speed.PV`` before ``speed.Q``.
    """
    words, own = parse_heading(heading).name.split(), parse_heading(other).name.split()
    if not any(map(_HEADING.fullmatch, words)):
        return False
    rest = [word for word in words if not _HEADING.fullmatch(word) and word not in _BESIDE]
    name = [word for word in own if word not in _BESIDE]
    if not rest:
        return is_beside and words != ['q'] and heading != other
    return rest == name or (is_beside and rest == name[: len(rest)])


def find_quality(heading: str, marks: Iterable[str]) -> Callable[[str], bool] | None:
    """Return what tells a mark by which a number does not count; None where the marks are no quality.

    Args:
        heading: The heading of the column.
        marks: Some of its cells.
    """
    known = {mark.strip() for mark in marks} - {''}
    is_hex = bool(known) and all(re.fullmatch(r'[0-9A-Fa-f]{8}', mark) for mark in known)
    codes = [code for mark in known if (code := _code_of(mark, is_hex=is_hex)) is not None]
    words = {*parse_heading(heading).name.split()}
    are_words = len(codes) < len(known)
    if any(code > _MAX_DA for code in codes) or words & {'statuscode'} or words >= {'status', 'code'}:
        is_bad_code = _is_bad_ua
    elif any(code & 0xFF >= _GOOD_DA for code in codes):
        is_bad_code = _is_bad_da
    elif words & {'qc', 'qf'}:
        is_bad_code = _is_bad_flag
    elif words & {'valid', 'validity', 'good'}:
        is_bad_code = _is_zero
    elif are_words or not any(codes):
        # Of zeros alone only a later code of OPC UA tells: in OPC DA all of them were bad.
        is_bad_code = _is_bad_ua
    else:
        return None

    has_good = any(map(_GOOD.match, known))

    def is_bad(mark: str) -> bool:
        code = _code_of(mark, is_hex=is_hex)
        if code is not None:
            return is_bad_code(code)
        return bool(_BAD.match(mark)) or (has_good and mark.strip() != '' and not _GOOD.match(mark))

    return is_bad


def _code_of(mark: str, *, is_hex: bool) -> int | None:
    """Return the code that a mark is or begins with; None for a word.

    A negative one is given as 32 bits without a sign; of more than 32 bits none is known as good.
    """
    match = _CODE.match(mark)
    if is_hex and re.fullmatch(r'\s*[0-9A-Fa-f]{8}\s*', mark):
        return int(mark, 16)
    if match is None:
        return None
    code = int(match[1], 16 if match[1][:2] in ('0x', '0X') else 10)
    return code & 0xFFFFFFFF if code < 0 else code


def _is_bad_ua(code: int) -> bool:
    return code >> _BITS_UA != 0


def _is_bad_da(code: int) -> bool:
    return code & _GOOD_DA != _GOOD_DA


def _is_bad_flag(code: int) -> bool:
    return code in _BAD_FLAGS


def _is_zero(code: int) -> bool:
    return code == 0
