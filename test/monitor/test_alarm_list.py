# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from sending import SECOND, Message, change, configured, stream_of, verdict_at

from stickslip_monitor import Monitor, MonitorConfig, Stream
from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.monitor.alarm_list import Action, AlarmChange, Annunciator, Flood
from stickslip_monitor.monitor.alarm_records import alarms_record
from stickslip_monitor.monitor.alarms import AlarmKind, AlarmState
from stickslip_monitor.monitor.severity import Condition
from stickslip_monitor.monitor.signals import VALUE_FAULTS, Input, Status

T0 = 1_700_000_000 * SECOND


class Panel:
    """An annunciator with a clock, and everything that has happened on it."""

    def __init__(self, config: MonitorConfig) -> None:
        self.alarms = Annunciator(config)
        self.second = 0.0
        self.condition = Condition.NORMAL
        self.log: list[AlarmChange] = []

    @property
    def stamp(self) -> int:
        return T0 + round(self.second * SECOND)

    def at(self, second: float) -> Panel:
        self.second = second
        self.log += self.alarms.advance(round(second * SECOND), self.stamp)
        return self

    def goes(self, condition: str) -> Panel:
        before, self.condition = self.condition, Condition(condition)
        return self._hears(before)

    def begins(self) -> Panel:
        """Stick-slip begins anew while its condition stands."""
        return self._hears(self.condition, onset=True)

    def _hears(self, before: Condition, onset: bool = False) -> Panel:
        event = change(self.stamp, before, self.condition, onset=onset)
        self.log += self.alarms.take_event(event)
        return self

    def turns(self, speed: float) -> Panel:
        self.log += self.alarms.take_verdict(verdict_at(self.stamp, speed))
        return self

    def absurd(self) -> Panel:
        self.log += self.alarms.take_fault('aft', 0, VALUE_FAULTS[Status.IMPLAUSIBLE], self.stamp)
        return self

    def does(self, action: str, kind: str | None = None, by: str = 'Ada') -> list[AlarmChange]:
        changes = self.alarms.act(Action(action), self.stamp, by, 'aft', AlarmKind(kind) if kind else None)
        self.log += changes
        return changes

    def state(self, kind: str) -> str:
        return self.alarms.alarms['aft'][AlarmKind(kind)].state.value

    @property
    def states(self) -> dict[str, str]:
        """The states that are not normal."""
        found = {alarm.kind.value: alarm.state.value for alarm in self.alarms}
        return {kind: state for kind, state in found.items() if state != 'normal'}

    @property
    def given(self) -> list[str]:
        """The alarms that people were given, in order."""
        return [change.kind.value for change in self.log if change.raised]

    @property
    def aloud(self) -> list[str]:
        """The alarms that began to sound, or sounded anew, in order."""
        return [change.kind.value for change in self.log if change.aloud]


Build = Callable[..., Panel]


@pytest.fixture
def panel() -> Build:
    def build(**changes: Any) -> Panel:
        delays = {'alarm__on_delay': 2.0, 'alarm__off_delay': 10.0, 'alarm__input_off_delay': 10.0}
        config = configured(**delays | changes)
        return Panel(replace(config, shelve_time_ns=600 * SECOND, silence_time_ns=30 * SECOND))

    return build


LADDER = [
    ('margin_low', 'caution'),
    ('bistable', 'bistable'),
    ('stick_slip', 'stick_slip'),
    ('amplitude_limit', 'amplitude_limit'),
    ('input_lost', 'input_stale'),
]


@pytest.mark.parametrize(('kind', 'condition'), LADDER)
def test_it_comes_and_goes_before_and_after_somebody_looks(panel: Build, kind: str, condition: str) -> None:
    aft = panel().at(1).goes(condition)
    assert (aft.given, aft.state(kind)) == ([kind], 'unacknowledged')
    aft.at(5).does('acknowledge')
    assert aft.state(kind) == 'acknowledged'
    aft.at(30).goes('normal').at(41)
    assert aft.states == {}
    alarm, text = aft.alarms.alarms['aft'][AlarmKind(kind)], f'aft: {Condition(condition).sentence}'
    assert (alarm.since_ns, alarm.count, alarm.text) == (T0 + SECOND, 1, text)
    aft.at(50).goes(condition).at(53).goes('normal').at(70)
    assert (aft.states, aft.alarms.sounding) == ({kind: 'returned_unacknowledged'}, False)
    aft.does('acknowledge')
    assert aft.states == {}


def test_latching_waits_for_its_reset(panel: Build) -> None:
    aft = panel(alarm__latch=True).at(1).goes('stick_slip')
    assert aft.does('reset') == []  # the cause is there
    aft.at(2).goes('normal')
    assert aft.does('reset') == []  # it went by itself and waits for somebody
    aft.does('acknowledge')
    assert aft.states == {'stick_slip': 'latched'}
    aft.at(3).goes('stick_slip')
    assert aft.given == ['stick_slip', 'stick_slip']
    aft.does('acknowledge')
    aft.at(4).goes('normal').does('reset')
    assert aft.states == {}


def test_absurd_values(panel: Build) -> None:
    aft = panel().at(1).absurd().at(2).absurd()
    assert aft.states == {}  # not yet for the on-delay of 2 s
    aft.at(3).absurd()
    assert aft.states == {'input_implausible': 'unacknowledged'}
    assert aft.log[-1].text == (
        'aft: Input speed implausible: on /shaft/speed, values are beyond the largest plausible magnitude.'
    )
    aft.does('acknowledge')
    aft.at(12.9)
    assert aft.states == {'input_implausible': 'acknowledged'}
    aft.at(13)  # none for the off-delay of 10 s
    assert aft.states == {}


def test_an_input_that_flickers_is_one_alarm(panel: Build) -> None:
    aft = panel()
    for second in range(0, 3600, 12):
        aft.at(second).goes('input_stale').at(second + 5).goes('normal')
        aft.does('acknowledge')
    assert aft.given == ['input_lost']
    aft.at(3600 + 5)
    assert aft.states == {}


def test_a_shelved_alarm_speaks_for_no_other(panel: Build) -> None:
    aft = panel().at(1)
    aft.does('shelve', 'stick_slip')
    aft.goes('stick_slip')
    assert aft.given == ['bistable']
    assert aft.state('stick_slip') == 'shelved'


def test_a_lost_input_neither_clears_nor_gives_what_was_there(panel: Build) -> None:
    aft = panel().at(1).goes('stick_slip')
    aft.does('acknowledge')
    aft.at(10).goes('input_stale').at(500).goes('stick_slip').at(600)
    assert aft.state('stick_slip') == 'acknowledged'
    assert aft.given == ['stick_slip', 'input_lost']


def test_a_latching_alarm_that_came_and_went_on_the_shelf_is_not_lost(panel: Build) -> None:
    aft = panel(alarm__latch=True).at(1)
    aft.does('shelve', 'stick_slip')
    aft.at(2).goes('stick_slip').at(3).goes('normal').at(601)
    assert aft.state('stick_slip') == 'returned_unacknowledged'


def test_to_shelve_what_stands_does_not_hide_what_comes(panel: Build) -> None:
    aft = panel().at(1).goes('caution')
    aft.does('shelve')
    assert aft.states == {'margin_low': 'shelved'}
    aft.at(2).goes('stick_slip')
    assert aft.given == ['margin_low', 'stick_slip']


def test_the_shelf_ends_by_itself(panel: Build) -> None:
    aft = panel().at(1).goes('stick_slip')
    aft.does('shelve')
    alarm = aft.alarms.alarms['aft'][AlarmKind.STICK_SLIP]
    assert alarm.shelved_until_ns == T0 + 601 * SECOND
    aft.at(600.9)
    assert (aft.state('stick_slip'), aft.alarms.sounding) == ('shelved', False)
    aft.at(601)
    assert aft.state('stick_slip') == 'unacknowledged'
    assert [(c.what, c.by) for c in aft.log if c.kind is AlarmKind.STICK_SLIP] == [
        ('raise', 'monitor'),
        ('shelve', 'Ada'),
        ('unshelve', 'timer'),
    ]
    # The covered ones came back with it, and it speaks for them.
    assert aft.given == ['stick_slip', 'stick_slip']


def test_a_shaft_at_rest_suppresses_the_ladder(panel: Build) -> None:
    aft = panel().at(0).turns(0.0)
    aft.at(9.9)
    assert aft.states == {}
    aft.at(10)
    ladder = ['amplitude_limit', 'stick_slip', 'bistable', 'margin_low']
    assert aft.states == dict.fromkeys(ladder, 'suppressed')
    aft.at(20).turns(20.0).at(21.9)
    assert aft.state('stick_slip') == 'suppressed'
    aft.at(22)
    assert aft.states == {}


def test_noise_about_the_minimum_speed_changes_nothing(panel: Build) -> None:
    aft = panel().at(0).turns(0.0).at(11)
    changes = len(aft.log)
    for second in range(12, 3600):
        aft.at(second).turns(20.0 if second % 2 else 0.0)
    assert len(aft.log) == changes == 4


def test_start_up_is_inhibited(panel: Build) -> None:
    aft = panel(alarm__startup_inhibit=60.0).at(0).turns(0.0).at(10)
    aft.turns(20.0).at(12).goes('stick_slip').at(71.9)
    assert (aft.given, aft.state('stick_slip')) == ([], 'suppressed')
    aft.at(72)
    assert aft.given == ['stick_slip']


def test_a_locked_shaft_suppresses_the_inputs_too(panel: Build) -> None:
    aft = panel().at(1)
    assert len(aft.does('suppress')) == 6
    assert aft.does('suppress') == []
    aft.at(2).goes('input_stale')
    assert (aft.given, set(aft.states.values())) == ([], {'suppressed'})
    aft.at(3).does('unsuppress')
    assert aft.states == {'input_lost': 'unacknowledged'}


def test_silence_is_a_flag_beside_the_life(panel: Build) -> None:
    aft = panel().at(1).goes('bistable')
    (change,) = aft.does('silence')
    assert change.before == change.after == 'unacknowledged'
    assert not aft.alarms.sounding
    aft.at(2).goes('input_stale')  # a new alarm sounds
    assert aft.alarms.sounding
    aft.does('silence')
    aft.at(31.9)
    assert aft.alarms.sounding  # the first one: 30 s are over
    aft.does('acknowledge', 'bistable')
    aft.at(31.95)
    assert not aft.alarms.sounding
    aft.at(32)
    assert aft.alarms.sounding
    assert [(c.what, c.by, c.kind.value) for c in aft.log if 'silence' in c.what] == [
        ('silence', 'Ada', 'bistable'),
        ('silence', 'Ada', 'input_lost'),
        ('unsilence', 'timer', 'bistable'),
        ('unsilence', 'timer', 'input_lost'),
    ]


def test_a_caution_is_shown_and_makes_no_sound(panel: Build) -> None:
    """IMO MSC.302(87), and the manuals of equipment by IEC 62923 (docs/rule.md)."""
    aft = panel().at(0).goes('caution')
    aft.absurd().at(1).absurd().at(2).absurd()
    assert aft.states == {'margin_low': 'unacknowledged', 'input_implausible': 'unacknowledged'}
    assert (aft.aloud, aft.alarms.sounding) == ([], False)
    assert aft.at(900).does('silence') == []


def test_what_flickers_keeps_its_silence(panel: Build) -> None:
    aft = panel().at(1).goes('bistable')
    aft.does('silence')
    aft.at(2).goes('normal').at(3).goes('bistable')
    assert not aft.alarms.sounding
    assert aft.given == ['bistable']


def test_what_is_not_found_again_after_a_restart_clears(panel: Build) -> None:
    aft = panel().at(1).goes('stick_slip')
    aft.does('acknowledge')
    aft.alarms.restart()
    aft.at(20).turns(60.0).at(31.9)
    assert aft.state('stick_slip') == 'acknowledged'
    aft.at(32)  # on-delay and off-delay: by now the ladder would have found it
    assert aft.states == {}


def test_an_unknown_bearing_is_refused(panel: Build) -> None:
    with pytest.raises(ConfigurationError, match="bearing 'bow' is not configured"):
        panel().alarms.act(Action.ACKNOWLEDGE, T0, 'Ada', 'bow')


def test_a_new_onset_waits_for_somebody_whatever_stood_before() -> None:
    panel = Panel(configured()).at(0.0).goes('stick_slip')
    panel.does('acknowledge')
    for second in (30.0, 60.0):
        panel.at(second).begins()
    alarm = panel.alarms.alarms['aft'][AlarmKind.STICK_SLIP]
    assert alarm.state is AlarmState.UNACKNOWLEDGED
    assert [c.what for c in panel.log if c.raised] == ['raise', 'recur']
    assert (alarm.came_back, alarm.first_ns) == (2, T0)
    panel.at(60.0 + 601.0).begins()
    assert (alarm.came_back, alarm.first_ns) == (0, T0 + 661 * SECOND)


@pytest.mark.parametrize('acknowledged', [True, False])
def test_every_onset_sounds(panel: Build, acknowledged: bool) -> None:
    aft = panel().at(0.0).goes('stick_slip')
    for number in range(1, 30):
        aft.does('acknowledge' if acknowledged else 'silence')
        assert not aft.alarms.sounding
        aft.at(12.0 * number).begins()
        assert aft.alarms.sounding
    assert aft.aloud == ['stick_slip'] * 30
    # A flood counts what was raised, not what sounded.
    assert aft.alarms.flood.most == (30 if acknowledged else 1)


def test_the_ladder_sounds_as_it_gets_worse(panel: Build) -> None:
    aft, lasting = panel(), 0
    for condition in ('bistable', 'normal', 'bistable', 'stick_slip', 'caution', 'bistable'):
        lasting += 100
        aft.at(lasting).goes(condition)
    assert aft.given == ['bistable', 'stick_slip', 'bistable']
    assert aft.aloud == ['bistable', 'stick_slip']
    aft.does('acknowledge')
    aft.at(700).goes('normal').at(1199).goes('bistable')  # ten minutes after it came last
    assert aft.aloud[2:] == []
    aft.does('acknowledge')
    aft.goes('normal').at(1800).goes('bistable')
    assert aft.aloud[2:] == ['bistable']


def test_what_came_without_a_sound_and_still_waits_sounds_after_ten_minutes(panel: Build) -> None:
    aft = panel().at(0).goes('bistable').at(20).goes('normal').at(40).goes('bistable')
    assert (aft.state('bistable'), aft.alarms.sounding) == ('unacknowledged', False)
    assert not aft.at(639.9).alarms.sounding
    assert aft.at(640).alarms.sounding


def test_an_onset_on_the_shelf_is_silent_and_no_milder_alarm_speaks_for_it(panel: Build) -> None:
    aft = panel().at(0).goes('stick_slip')
    aft.does('shelve', 'stick_slip')
    aft.at(20).begins()
    assert (aft.aloud, aft.alarms.sounding) == (['stick_slip'], False)
    assert aft.state('bistable') == 'acknowledged'
    assert aft.alarms.alarms['aft'][AlarmKind.STICK_SLIP].came_back == 1


def test_an_onset_sounds_where_only_the_amplitude_limit_is_shelved(panel: Build) -> None:
    aft = panel().at(0).goes('amplitude_limit')
    aft.does('shelve', 'amplitude_limit')
    aft.at(20).begins()
    assert aft.aloud == ['amplitude_limit', 'stick_slip']


@pytest.mark.parametrize('before', ['bistable', 'normal'])
def test_a_worse_alarm_acknowledges_what_it_covers(panel: Build, before: str) -> None:
    aft = panel().at(0).goes(before).at(1).goes('stick_slip')
    assert aft.given[-1:] == ['stick_slip']
    assert aft.state('stick_slip') == 'unacknowledged'
    assert aft.state('bistable') == aft.state('margin_low') == 'acknowledged'
    assert aft.log[-1].by == 'monitor'
    aft.at(30).goes('bistable')  # easing gives nothing
    assert aft.state('bistable') == 'acknowledged'


def test_one_row_a_bearing() -> None:
    panel = Panel(configured()).at(0.0).goes('caution').at(1.0).goes('stick_slip')
    (row,) = alarms_record(panel.alarms, [], T0, 1, text_of=lambda name: f'{name}: now')['rows']
    assert (row['alarm'], row['state']) == ('stick_slip', 'unacknowledged')
    assert (row['text'], row['first_text']) == ('aft: now', 'aft: Stick-slip predicted.')
    assert row['kinds'] == ['stick_slip', 'bistable', 'margin_low']


def test_what_is_active_comes_before_what_is_over_and_waits() -> None:
    panel = Panel(configured()).at(0.0).goes('stick_slip').at(20.0).goes('normal')

    def row() -> tuple[str, str]:
        (one,) = alarms_record(panel.alarms, [], T0, 1, text_of=str)['rows']
        return one['alarm'], one['state']

    assert row() == ('stick_slip', 'returned_unacknowledged')
    panel.at(30.0).goes('input_stale').at(60.0)
    assert row() == ('input_lost', 'unacknowledged')
    panel.does('acknowledge', 'input_lost')
    # Its colleague still waits for somebody.
    assert row() == ('input_lost', 'unacknowledged')
    panel.does('acknowledge')
    assert row() == ('input_lost', 'acknowledged')


MINUTE = 60 * SECOND


def _figures(lately: int, most: int, flooding: bool) -> dict[str, int]:
    return {'alarms_10min': lately, 'most_10min': most, 'flooding': flooding}


def test_a_flood_begins_above_ten_and_ends_below_five() -> None:
    flood = Flood()
    for minute in range(10):
        flood.add(minute * MINUTE // 2)
    assert flood.figures(5 * MINUTE) == _figures(10, 10, False)
    flood.add(5 * MINUTE)
    assert flood.figures(5 * MINUTE) == _figures(11, 11, True)
    # The alarms of 0, 0.5, ... 5 minutes leave the window one by one, each after 10 minutes.
    assert flood.figures(13 * MINUTE - 1) == _figures(5, 11, True)
    assert flood.figures(13 * MINUTE) == _figures(4, 11, False)
    assert flood.figures(15 * MINUTE) == _figures(0, 11, False)


def _watch(config: MonitorConfig, stream: Stream, hours: int) -> tuple[list[AlarmChange], int]:
    """The events of a recording, with somebody who acknowledges once a minute."""
    events = Monitor(config).scan({'aft': stream}, 0, hours * 3600 * SECOND)['aft'].events
    annunciator, log = Annunciator(config), []
    times = [(event.time_ns, event) for event in events]
    times += [(minute * MINUTE, None) for minute in range(1, 60 * hours)]
    for now, event in sorted(times, key=lambda item: item[0]):
        log += annunciator.advance(now, now)
        if event is not None:
            log += annunciator.take_event(event)
        else:
            log += annunciator.act(Action.ACKNOWLEDGE, now, 'Ada')
    return [change for change in log if change.raised], annunciator.flood.most


@pytest.mark.slow
def test_eight_hours_of_chatter_about_every_threshold_are_no_flood() -> None:
    config = configured(alarm__amplitude_limit=0.92e-3)
    # At 1000 N: caution to 44.79 and 45.61 rpm, fold 40.72, Hopf 30.74, the amplitude limit at
    # 34.4 to 35.1 while it sticks, rest at 0. One hour at each, in a swell of 9 s and with noise.
    levels = [45.2, 40.72, 30.74, 34.8, 30.74, 0.0, 40.72, 45.2]
    random = np.random.default_rng(3)
    time = np.arange(0.0, 8 * 3600.0, 0.5)
    mean = np.repeat(levels, 7200)
    rpm = mean + 0.8 * np.sin(2.0 * math.pi * time / 9.0) + random.normal(0.0, 0.8, time.size)
    # The load comes and goes: with gaps of just above and just below its timeout of 5 s.
    sent = [Message(t, Input.SPEED, t, n) for t, n in zip(time.tolist(), rpm.tolist(), strict=True)]
    sent += [Message(t, Input.LOAD, t, 1000.0) for t in np.cumsum(random.choice([4.8, 5.2], 5600)).tolist()]
    stream = stream_of(sorted(m for m in sent if m.arrival < 8 * 3600.0))
    given, most = _watch(config, stream, 8)
    crossings = int(np.sum(np.abs(np.diff(np.sign(rpm - mean))) > 0))
    assert crossings > 10_000
    assert {change.kind.value for change in given} == {
        *('margin_low', 'bistable', 'stick_slip', 'amplitude_limit', 'input_lost')
    }
    # ISA-18.2: more than ten in ten minutes are a flood, one is very likely acceptable.
    assert most <= 10
    assert len(given) <= 48  # one in ten minutes
