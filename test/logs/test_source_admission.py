# SPDX-License-Identifier: Apache-2.0
"""One of several senders of a value is used, and the others are named."""

from __future__ import annotations

from stickslip_logs.source_admission import SourceAdmission


def test_one_source_is_used_and_the_others_are_named() -> None:
    notes: list[str] = []
    admission = SourceAdmission(label := 'NMEA RPM S 1', 5.0, '', notes.append)
    steps = [
        ('c', 0.9, False, True),  # nothing else sends
        ('a', 1.0, True, True),
        ('b', 1.1, True, False),
        ('a', 2.0, True, True),
        ('b', 2.1, True, False),
        ('a', 3.0, False, True),  # that a has no number any more is passed on
        ('b', 4.4, True, False),  # a has no number for less than half of the time-out of 5 s
        ('b', 4.6, True, True),
        ('a', 4.7, True, False),
        ('a', 9.7, False, False),  # b is silent, and a has no number either
    ]
    admitted = [admission.admits(source, now, valid=valid) for source, now, valid, _ in steps]
    assert admitted == [expected for *_, expected in steps]
    assert notes == [
        f"{label}: source 'a' is used; 'c' has sent no number",
        f"{label}: source 'b' is left out: 'a' sends",
        f"{label}: source 'b' is used; 'a' has sent no number for 2.6 s",
        f"{label}: source 'a' is left out: 'b' sends",
    ]
    chosen = SourceAdmission(label, 5.0, 'b', notes.append)
    assert [chosen.admits(source, 9.0) for source in 'aba'] == [False, True, False]
    assert notes[4:] == [f"{label}: source 'a' is left out: 'b' is chosen"]


def test_a_clock_that_is_set_back_keeps_no_silent_sender() -> None:
    # By the clock of a log a silence of 2 s before the step and of 1 s behind it is one of 3 s.
    admission = SourceAdmission('RPM S 1', 5.0, '', str)
    steps = [
        ('a', 3600.0, True),
        ('b', 3602.0, False),
        ('b', 0.0, False),
        ('b', 0.4, False),
        ('b', 1.0, True),
    ]
    assert [admission.admits(source, now) for source, now, _ in steps] == [expected for *_, expected in steps]
