# SPDX-License-Identifier: Apache-2.0
"""Finds columns of marks that say whether the numbers of another count: words, flags, codes of OPC.

OPC DA (Data Access 3.00, section 6.8): the two highest bits of the low byte are 11 for good, so 192 and more.
OPC UA (Part 4, section 7.39): the two highest of 32 bits are the severity, 00 for good. Flags of quality
control (QARTOD, Argo): 3 is suspect, 4 is bad, 9 is missing.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence

from stickslip_logs.tables.dialect import parse_heading

# A word of a heading that makes it one of a quality, and what may stand beside it or beside a signal's name.
_QUALITY = re.compile(r'q|qc|qf|good|(?:opc)?(?:status(?:code)?|qual|qualit\w*|valid|validity)')
_BESIDE = {'code', 'flag', 'value', 'val', 'wert'}
# Marks are those of a quality if one is of the first kind or a code, or all are of the second kind; then
# any word that is not of the first kind is bad.
_GOOD = re.compile(r'\s*(?:good|ok|valid|true)', re.I)
_BAD = re.compile(
    r'\s*(?:0x|bad|invalid|uncertain|false|fail|fault|err|stale|not (?!run|ready)|comm|timeout)', re.I
)
_CODE = re.compile(r'\s*(0x[0-9a-f]+|[-+]?\d+)(?:\.0*)?(?![\w.])', re.I)
_HEX = re.compile(r'\s*[0-9A-Fa-f]{8}\s*')
_GOOD_DA = 0xC0
_IS_BAD: dict[str, Callable[[int], bool]] = {
    'OPC UA': lambda code: code >> 30 != 0,
    'OPC DA': lambda code: code & _GOOD_DA != _GOOD_DA,
    'flag': lambda code: code in (3, 4) or code > 8,
    'validity': lambda code: code != 1,
}


def is_quality_of(heading: str, signal: str, *, is_beside: bool) -> bool:
    """Return whether a heading is that of the quality of a signal; False for equal headings.

    If its column stands behind that of the signal (``is_beside``), it may leave some words of the signal's
    heading out, as ``speed.Q`` behind ``speed.PV``, or all of them; but ``Q`` alone is a flow.
    """
    named = _named_signal(heading)
    if named is None or heading == signal:
        return False
    words = [word for word in parse_heading(signal).name.split() if word not in _BESIDE]
    if not named:
        return is_beside and parse_heading(heading).name != 'q'
    return named == words or (is_beside and named == words[: len(named)])


def find_quality_columns(headings: Sequence[str]) -> set[int]:
    """Return the places of the headings that name the quality of another heading; empty if there are none."""
    return {
        k
        for k, heading in enumerate(headings)
        if _named_signal(heading) and any(is_quality_of(heading, name, is_beside=False) for name in headings)
    }


def _named_signal(heading: str) -> list[str] | None:
    """Return the words of a heading but for those of a quality and such as 'value' or 'flag', in lower case.

    An empty list where it has no others; None where it has no word of a quality.
    """
    words = parse_heading(heading).name.split()
    if not any(map(_QUALITY.fullmatch, words)):
        return None
    return [word for word in words if not _QUALITY.fullmatch(word) and word not in _BESIDE]


def find_bad_mark_test(heading: str, marks: Iterable[str]) -> Callable[[str], bool] | None:
    """Return a function that is True for a mark by which a number does not count.

    An unknown word beside known marks is such a mark, an empty one is not. Returns None where neither the
    heading nor the marks of the column show what these mean.
    """
    seen = {mark.strip() for mark in marks} - {''}
    is_hex = bool(seen) and all(map(_HEX.fullmatch, seen))
    codes = [code for mark in seen if (code := _code_of(mark, is_hex=is_hex)) is not None]
    words = {*parse_heading(heading).name.split()}
    # No code of OPC UA has these bits; a good one of OPC DA has, and one of a historian more than 16 bits.
    if any(code & 0xFF >= _GOOD_DA for code in codes):
        kind = 'OPC DA'
    elif max(codes, default=0) > 0xFFFF or words & {'statuscode'} or words >= {'status', 'code'}:
        kind = 'OPC UA'
    elif words & {'qc', 'qf'} and max(codes, default=0) < 10:
        kind = 'flag'
    elif words & {'valid', 'validity', 'good'} and max(codes, default=0) < 2:
        kind = 'validity'
    elif len(codes) < len(seen) or not any(codes):
        # Of zeros alone only a later code of OPC UA tells: in OPC DA all of them were bad.
        kind = 'OPC UA'
    else:
        return None
    if not codes and not any(map(_GOOD.match, seen)) and not (seen and all(map(_BAD.match, seen))):
        return None

    def is_bad(mark: str) -> bool:
        """Return whether a number with a mark does not count; an empty mark is not bad."""
        code = _code_of(mark, is_hex=is_hex)
        if code is not None:
            return _IS_BAD[kind](code)
        return mark.strip() != '' and not _GOOD.match(mark)

    return is_bad


def _code_of(mark: str, *, is_hex: bool) -> int | None:
    """Return the code that a mark is or begins with; None for a word.

    Without a prefix eight digits are hexadecimal if ``is_hex``. A negative code is returned as an unsigned
    one of 32 bits. A longer code is not shortened, so that it counts as bad.
    """
    if is_hex and _HEX.fullmatch(mark):
        return int(mark, 16)
    match = _CODE.match(mark)
    if match is None:
        return None
    code = int(match[1], 16 if match[1][:2] in ('0x', '0X') else 10)
    return code & 0xFFFFFFFF if code < 0 else code
