# SPDX-License-Identifier: Apache-2.0
"""The sentences, by golden strings, by tables, and by another reader."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import datetime, timezone
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sending import Ship
from shared import CONFIG

from stickslip_monitor.links.links_config import BusInput
from stickslip_monitor.links.nmea import (
    MAX_SENTENCE,
    Alerts,
    NmeaInputs,
    SentenceStream,
    clean_display_text,
    format_sentence,
    parse_sentence,
    shorten_names,
)
from stickslip_monitor.monitor.alarm_list import Action
from stickslip_monitor.monitor.alarm_records import ActionRequest
from stickslip_monitor.monitor.alarm_states import AlarmKind
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.monitor.sample_types import Input

SPEED = BusInput(bus='nmea', bearing='aft', place=Input.SPEED, sentence='RPM', kind='S', number=1)
LOAD = BusInput(bus='nmea', bearing='aft', place=Input.LOAD, sentence='XDR', kind='N', name='AFTLOAD')
NAN = math.nan


def samples(inputs: list[BusInput], line: str) -> list[tuple[str, Input, float]]:
    return list(NmeaInputs(inputs, print).take(line, 0.0))


RPM = '$RCRPM,S,1,74.6,30.0,A'  # its checksum is 56


@pytest.mark.parametrize(
    ('body', 'expected'),
    [
        ('RCRPM,S,1,74.6,30.0,A', [74.6]),
        ('IIRPM,S,01,-74.6,,A', [-74.6]),
        ('RCRPM,S,1,74.6,30.0,V', [NAN]),  # invalid: no shaft at 74.6 rpm, and none at rest
        ('RCRPM,S,1,,30.0,V', [NAN]),
        ('RCRPM,S,1,,30.0,A', [NAN]),
        ('RCRPM,S,1,74.6,30.0', [NAN]),  # no flag
        ('RCRPM,S,1, 74.6,30.0,A', [74.6]),  # numbers of one width
        ('ERRPM,S,1,251.0,A', [251.0]),  # a ship's form, without pitch
        ('ERRPM,S,1,251.0,V', [NAN]),
        ('RCRPM,S,1,74.6,30.0,', [NAN]),
        ('RCRPM,S,1,nan,30.0,A', [NAN]),
        ('RCRPM,S,1,7_4,30.0,A', [NAN]),
        ('RCRPM,S,2,74.6,30.0,A', []),
        ('RCRPM,E,1,74.6,30.0,A', []),
        ('RCRPM,S', []),
        ('RCROT,S,1,74.6,30.0,A', []),
        ('IIXDR,N,998.4,N,AFTLOAD', [998.4]),
        ('IIXDR,C,20.0,C,OIL,N,998.4,N,AFTLOAD,N,1.0,N,FWDLOAD', [998.4]),
        ('IIXDR,N,,N,AFTLOAD', [NAN]),
        ('IIXDR,N,99.8,P,AFTLOAD', []),  # a percentage is no force
        ('IIXDR,N,998.4,N', []),
        ('IIXDR', []),
    ],
)
def test_numbers_of_a_sentence(body: str, expected: list[float]) -> None:
    for line in (format_sentence(body), f'UdPbC\0\\s:RC0001,n:12*39\\{format_sentence(body)}\r\n'):
        samples_of_line = list(samples([SPEED, LOAD], line))
        assert [value for *_, value in samples_of_line] == pytest.approx(expected, nan_ok=True)
        assert {item[:2] for item in samples_of_line} <= {('aft', 0), ('aft', 1)}


def test_a_talker_is_chosen() -> None:
    port = replace(SPEED, talker='RC')
    assert list(samples([port], format_sentence('IIRPM,S,1,74.6,30.0,A'))) == []
    assert list(samples([port], format_sentence('RCRPM,S,1,74.6,30.0,A'))) == [('aft', 0, 74.6)]


@pytest.mark.parametrize('line', [f'{RPM}*00', RPM, RPM[:10], '', '$', '\xff\xfe$$$***'])
def test_a_line_without_its_checksum_is_nothing(line: str) -> None:
    assert parse_sentence(line) is None
    assert list(samples([SPEED], line)) == []


TWO = (
    f'{format_sentence("RCRPM,S,1,74.6,30.0,A")}\r\n{format_sentence("IIXDR,N,998.4,N,AFTLOAD")}\r\n'.encode()
)


@pytest.mark.parametrize('cut', range(1, len(TWO)))
def test_a_sentence_cut_anywhere_is_whole_again(cut: int) -> None:
    stream = SentenceStream()
    sentences = stream.take(TWO[:cut]) + stream.take(TWO[cut:])
    assert sentences == TWO.decode().split()
    assert stream.unused.total() == 0


@pytest.mark.parametrize('end', [b'\r', b'\n', b'', b'\0', b' noise '])
def test_sentences_with_any_end_or_none(end: bytes) -> None:
    rpm_sentence, load_sentence = TWO.split()
    assert SentenceStream().take(rpm_sentence + end + load_sentence + end) == TWO.decode().split()


def test_unused_sentences_are_counted() -> None:
    stream = SentenceStream()
    bad = TWO.replace(b'74.6', b'74.7')
    assert len(stream.take(b'$RCRPM,S,1,1.0,,A\r\n' + bad + b'$RCRPM,S,1,7' + TWO)) == 3
    # The start that another sentence cut off has no checksum either.
    assert stream.unused == {'no checksum': 2, 'bad checksum': 1}
    # At another baud rate bytes come that are no text, with a $ among them or none.
    for noise in (b'x' * 10_000_000, b'\xf0\x80$\xe3\x00\r\n'):
        stream = SentenceStream()
        assert stream.take(noise) == []
        assert stream.unused == {'unreadable (another baud rate?)': 1}
    # A maker's own sentence has a name of another length.
    assert len(stream.take(f'{format_sentence("PFEC,GPatt,12.0")}\r\n$PFEC,GPatt\r\n'.encode())) == 1
    assert stream.unused['no checksum'] == 1


def test_a_silent_input_is_logged_with_the_sentences_received_instead() -> None:
    lines: list[str] = []
    inputs = NmeaInputs([SPEED, LOAD], lines.append)
    inputs.log_silent(0.0, {})
    for body in ('RCRPM,E,1,700,,A', 'RCRPM,E,1,700,,A', 'IIXDR,N,1.2,K,AFTLOAD', 'RCRPM,S,1,74.6,30.0,V'):
        assert not [value for *_, value in inputs.take(format_sentence(body), 1.0) if value == value]
    inputs.log_silent(4.9, {})
    assert lines == []
    for _ in range(2):
        inputs.log_silent(5.0, {'bad checksum': 16})
    assert lines == [
        'NMEA RPM S 1: no valid number for 5 s; received instead: bad checksum (16), RPM,E,1 (2),'
        ' invalid by its talker (1)',
        'NMEA XDR AFTLOAD: no valid number for 5 s; received instead: bad checksum (16),'
        ' XDR AFTLOAD as type N in K, and only type N in N is used (1)',
    ]
    assert list(inputs.take(format_sentence('RCRPM,S,1,74.6,30.0,A'), 6.0))
    assert lines[2:] == ['NMEA RPM S 1: values again']
    for _ in range(3):
        assert not list(inputs.take(format_sentence('HEHDT,12.0,T'), 12.0))
    assert list(inputs.take(format_sentence('IIXDR,N,1.2,N,AFTLOAD'), 12.0))
    inputs.log_silent(17.0, {})
    # What came before the last number is not heard any more.
    no_number = 'no valid number for 5 s'
    assert lines[3:] == [
        'NMEA XDR AFTLOAD: values again',
        f'NMEA RPM S 1: {no_number}; received instead: other sentences (4)',
        f'NMEA XDR AFTLOAD: {no_number}; nothing received: check the line and the port',
    ]


def test_titles_tell_bearings_apart() -> None:
    assert shorten_names(['aft_stern']) == ['AFT']
    assert shorten_names(['aft_stern', 'aft_steering', 'fwd']) == ['AFT 1', 'AFT 2', 'FWD']
    assert shorten_names(['starboard', 'starship']) == ['STARB', 'STARS']
    alerts = Alerts(['aft_stern', 'aft_steering'], 'II', '', 10001, False)
    titles = {a.title for a in alerts._alerts.values()}
    assert len(titles) == 2 * len(AlarmKind)
    assert max(map(len, titles)) <= 16


@pytest.mark.parametrize(
    ('rpm', 'kind'),
    [(20.0, AlarmKind.STICK_SLIP), (-20.0, AlarmKind.STICK_SLIP), (42.0, AlarmKind.MARGIN_LOW)],
)
def test_the_text_of_an_alert_says_what_to_do(rpm: float, kind: AlarmKind) -> None:
    # The speed is that of the alarm's own text: at it the caution is over, too.
    ship = Ship(load_config(CONFIG))
    ship.sail(20.0)
    ship.sail(20.0, rpm)
    (alarm,) = [row for row in ship.published[-1]['alarms'] if row['alarm'] == kind]
    panel = Panel()
    lines = panel.show(kind, 'unacknowledged', '06:00:55.50', text=alarm['text'])
    astern = ' ASTERN' if rpm < 0.0 else ''
    # The fold at 40.7231 rpm (docs/accuracy.md), the margin and the hysteresis of the file.
    alarms = ship.config.bearings[0].alarm
    clear = math.ceil(40.7231 * (1.0 + alarms.caution_margin + alarms.hysteresis))
    assert f'above {clear} rpm' in alarm['text']
    goal = f'ABOVE {clear} RPM{astern}'
    order = f'CLEARS {goal}' if kind is AlarmKind.MARGIN_LOW else f'{goal} OR STOP'
    expected = f'{order}. NOW {abs(rpm):.0f} RPM 1 KN'
    assert parse_sentence(lines[1])[2][-1] == expected
    assert len(expected) <= 48


def test_the_text_of_another_alert_is_cut_at_a_word() -> None:
    panel = Panel()
    lost = 'aft: No valid value on /a/very/long/topic/name/indeed for 5 s: is its sensor connected?'
    lines = panel.show(AlarmKind.INPUT_LOST, 'unacknowledged', '06:00:55.50', text=lost)
    text = parse_sentence(lines[1])[2][-1]
    assert len(text) <= 48
    assert clean_display_text(lost.partition(': ')[2]).startswith(f'{text} ')


@given(st.text(max_size=100))
def test_any_line_is_survived(line: str) -> None:
    assert parse_sentence(line) is None or line.count('*')
    alerts = Alerts(['aft'], 'II', '', 10001, True)
    assert alerts.handle_acn(line, 0) == ([], None)


class Panel:
    """An alarm list in the form that the monitor publishes, at times of one day."""

    def __init__(self, **options: Any) -> None:
        settings = {'talker': 'II', 'manufacturer': 'XXX', 'first_alert': 10001}
        self.alerts = Alerts(['aft'], accept_actions=True, **settings | options)

    def show(self, kind: AlarmKind, state: str, at: str, silenced: bool = False, text: str = '') -> list[str]:
        time = datetime.strptime(f'2026-11-22 {at}', '%Y-%m-%d %H:%M:%S.%f')
        time_ns = round(time.replace(tzinfo=timezone.utc).timestamp() * 1000) * 10**6
        change = {'time': time_ns, 'bearing': 'aft', 'alarm': kind.value}
        alarm = {**change, 'state': state, 'silenced': silenced, 'text': text, 'changed': 0}
        return self.alerts.take_alarms({'time': 0, 'changes': [change], 'alarms': [alarm]})


STUCK = 'aft: Stick-slip predicted at 20 rpm, 1 kN'


def test_the_life_of_an_alarm_in_golden_sentences() -> None:
    panel, kind = Panel(), AlarmKind.STICK_SLIP
    steps = [
        ('unacknowledged', '06:00:55.50', False),
        ('unacknowledged', '06:00:57.00', True),
        ('unacknowledged', '06:01:27.00', False),
        ('acknowledged', '06:01:30.00', False),
        ('normal', '06:02:10.00', False),
        ('unacknowledged', '06:03:00.00', False),
        ('returned_unacknowledged', '06:03:10.00', False),
        ('normal', '06:03:20.00', False),
    ]
    lines = [panel.show(kind, state, at, silent, STUCK) for state, at, silent in steps]
    assert lines[0] == [
        '$IIALF,2,1,1,060055.50,B,A,V,XXX,10002,1,1,0,STICK-SLIP AFT*68',
        '$IIALF,2,2,1,,,,,XXX,10002,1,1,0,STICK-SLIP PREDICTED AT 20 RPM 1 KN*50',
    ]
    assert lines[1:5] == [
        ['$IIALF,1,1,2,060057.00,B,A,S,XXX,10002,1,2,0,STICK-SLIP AFT*69'],
        ['$IIALF,1,1,3,060127.00,B,A,V,XXX,10002,1,3,0,STICK-SLIP AFT*6A'],
        ['$IIALF,1,1,4,060130.00,B,A,A,XXX,10002,1,4,0,STICK-SLIP AFT*7B'],
        ['$IIALF,1,1,5,060210.00,B,A,N,XXX,10002,1,5,0,STICK-SLIP AFT*75'],
    ]
    assert lines[5][0] == format_sentence('IIALF,2,1,6,060300.00,B,A,V,XXX,10002,1,6,0,STICK-SLIP AFT')
    assert lines[6:] == [
        ['$IIALF,1,1,7,060310.00,B,A,U,XXX,10002,1,7,0,STICK-SLIP AFT*6F'],
        ['$IIALF,1,1,8,060320.00,B,A,N,XXX,10002,1,8,0,STICK-SLIP AFT*77'],
    ]
    assert panel.show(kind, 'normal', '06:03:21.00') == []


@pytest.mark.parametrize(
    ('kind', 'identifier', 'priority', 'states', 'letters'),
    [
        (AlarmKind.AMPLITUDE_LIMIT, 10001, 'A', ['unacknowledged'], 'V'),
        (AlarmKind.BISTABLE, 10003, 'W', ['unacknowledged', 'acknowledged'], 'VA'),
        # Nobody has to acknowledge a caution, nor its end.
        (AlarmKind.MARGIN_LOW, 10004, 'C', ['unacknowledged', 'returned_unacknowledged'], 'AN'),
        (AlarmKind.INPUT_LOST, 10005, 'W', ['unacknowledged', 'returned_unacknowledged'], 'VU'),
        (AlarmKind.INPUT_IMPLAUSIBLE, 10006, 'C', ['acknowledged'], 'A'),
        # What is put aside is normal to a display.
        *(
            (AlarmKind.STICK_SLIP, 10002, 'A', ['acknowledged', aside], 'AN')
            for aside in ('latched', 'suppressed', 'shelved', 'out_of_service')
        ),
    ],
)
def test_every_kind(kind: AlarmKind, identifier: int, priority: str, states: list[str], letters: str) -> None:
    panel = Panel()
    for state, letter in zip(states, letters, strict=True):
        parsed = parse_sentence(panel.show(kind, state, '06:00:00.00')[0])
        assert parsed[2][4:9] == ['B', priority, letter, 'XXX', f'{identifier}']


def test_the_cyclic_list_and_the_heartbeat() -> None:
    panel = Panel()
    panel.show(AlarmKind.STICK_SLIP, 'unacknowledged', '06:00:00.00')
    panel.show(AlarmKind.BISTABLE, 'unacknowledged', '06:00:00.00')
    panel.show(AlarmKind.BISTABLE, 'acknowledged', '06:00:01.00')
    listed = panel.alerts.make_list()
    assert listed == ['$IIALC,01,01,00,2,XXX,10002,1,1,XXX,10003,1,2*7E']
    assert Panel().alerts.make_list() == [format_sentence('IIALC,01,01,00,0')]
    assert panel.alerts.make_heartbeat(60.0, True) == '$IIHBT,60.0,A,0*1B'
    assert panel.alerts.make_heartbeat(60.0, False) == '$IIHBT,60.0,V,1*0D'


def test_a_long_list_is_split_and_counted() -> None:
    alerts = Alerts([f'b{n}' for n in range(20)], 'II', 'XXX', 9_999_990, False)
    alarm = {'state': 'unacknowledged', 'silenced': False, 'text': 'x' * 200, 'changed': 0}
    alarms = [{**alarm, 'bearing': f'b{n}', 'alarm': kind.value} for n in range(20) for kind in AlarmKind]
    lines = alerts.take_alarms({'time': 0, 'changes': [], 'alarms': alarms})
    listed = alerts.make_list()
    assert sum(int(line.split(',')[4].partition('*')[0]) for line in listed) == 20 * len(AlarmKind)
    assert {line.split(',')[1] for line in listed} == {'47'}
    assert max(len(line) + 2 for line in lines + listed) <= MAX_SENTENCE
    assert {line.split(',')[3] for line in lines} == set('0123456789')


def test_revisions_restart_after_99() -> None:
    panel = Panel()
    revisions = []
    for step in range(102):
        state = 'acknowledged' if step % 2 else 'unacknowledged'
        line = panel.show(AlarmKind.BISTABLE, state, '06:00:00.00')[0]
        revisions.append(int(line.split(',')[11]))
    assert revisions == [*range(1, 100), 1, 2, 3]


ACKNOWLEDGE = '$BNACN,060130.00,XXX,10002,1,A,C*32'
SILENCE = '$BNACN,060057.00,XXX,10002,1,S,C*20'
NOW = 6 * 3600 * 10**9 + 91 * 10**9  # 06:01:31


@pytest.mark.parametrize(
    ('state', 'line', 'action', 'answer'),
    [
        ('unacknowledged', ACKNOWLEDGE, Action.ACKNOWLEDGE, []),
        ('unacknowledged', SILENCE, Action.SILENCE, []),
        ('returned_unacknowledged', ACKNOWLEDGE, Action.ACKNOWLEDGE, []),
        ('acknowledged', ACKNOWLEDGE, None, ['$IIARC,060131.00,XXX,10002,1,A*4C']),
        ('normal', SILENCE, None, [format_sentence('IIARC,060131.00,XXX,10002,1,S')]),
        (
            'unacknowledged',
            '$BNACN,060059.00,XXX,10002,1,O,C*32',
            None,
            [format_sentence('IIARC,060131.00,XXX,10002,1,O')],
        ),
        ('unacknowledged', format_sentence('BNACN,060130.00,XXX,10002,1,A,'), None, []),
        ('unacknowledged', format_sentence('BNACN,060130.00,YYY,10002,1,A,C'), None, []),
        ('unacknowledged', format_sentence('BNACN,060130.00,XXX,10002,2,A,C'), None, []),
        ('unacknowledged', format_sentence('BNACN,060130.00,XXX,99999,1,A,C'), None, []),
        ('unacknowledged', ACKNOWLEDGE.replace('*32', '*33'), None, []),
    ],
)
def test_request_of_a_display(state: str, line: str, action: Action | None, answer: list[str]) -> None:
    panel = Panel()
    panel.show(AlarmKind.STICK_SLIP, state, '06:00:00.00')
    request = action and ActionRequest(action, 'nmea', 'aft', AlarmKind.STICK_SLIP)
    assert panel.alerts.handle_acn(line, NOW) == (answer, request)


def test_a_display_asks_for_everything_again() -> None:
    panel = Panel()
    raised = panel.show(AlarmKind.STICK_SLIP, 'unacknowledged', '06:00:55.50', text=STUCK)
    repeated, request = panel.alerts.handle_acn('$BNACN,060058.00,XXX,10002,1,Q,C*2D', NOW)
    assert request is None
    assert repeated[0].split(',')[4:12] == raised[0].split(',')[4:12]


def test_a_caution_is_not_acknowledged_and_without_leave_nothing_is() -> None:
    panel = Panel()
    panel.show(AlarmKind.MARGIN_LOW, 'unacknowledged', '06:00:00.00')
    caution = format_sentence('BNACN,060130.00,XXX,10004,1,A,C')
    refused = [format_sentence('IIARC,060131.00,XXX,10004,1,A')]
    assert panel.alerts.handle_acn(caution, NOW) == (refused, None)
    deaf = Alerts(['aft'], 'II', 'XXX', 10001, False)
    refused = [format_sentence('IIARC,060131.00,XXX,10002,1,A')]
    assert deaf.handle_acn(ACKNOWLEDGE, NOW) == (refused, None)


@given(st.text(max_size=60))
def test_reserved_characters_are_never_sent(text: str) -> None:
    lines = Panel().show(AlarmKind.STICK_SLIP, 'unacknowledged', '06:00:00.00', text=text)
    for line in lines:
        assert parse_sentence(line) is not None
        assert len(line) + 2 <= MAX_SENTENCE
    assert set(clean_display_text(text)) <= set('ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789 .+-%')


def test_another_reader_reads_them_all() -> None:
    reader = pytest.importorskip('pynmeagps', reason='pynmeagps is not installed').NMEAReader
    panel = Panel()
    lines = panel.show(AlarmKind.STICK_SLIP, 'unacknowledged', '06:00:55.50', text=STUCK)
    lines += [*panel.alerts.make_list(), panel.alerts.make_heartbeat(60.0, True)]
    lines += panel.alerts.handle_acn(format_sentence('BNACN,060059.00,XXX,10002,1,O,C'), NOW)[0]
    read = [reader.parse(f'{line}\r\n', validate=1) for line in lines]
    assert [message.msgID for message in read] == ['ALF', 'ALF', 'ALC', 'HBT', 'ARC']
