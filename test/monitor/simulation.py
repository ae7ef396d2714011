# SPDX-License-Identifier: Apache-2.0
"""A ship of two bearings under faults, on clocks of its own: one seed is one run, always the same.

The bus loses, delays, doubles and stamps oddly, senders pause and bring numbers that mean "no
value", the clock on the wall is set, the process is held up, killed and started again from a store
that is full or torn, people act, and the configuration changes; the seconds with a wrong condition
are counted. Then all faults stop, and after :data:`CALM` the condition must be the true one. Last
come the manoeuvres of :mod:`manoeuvres`, which must be announced in time and aloud.
"""

from __future__ import annotations

import heapq
import math
import random
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cache

import manoeuvres
from manoeuvres import STICKING, Manoeuvres, Report
from sending import SECOND, T0, Message, Ship, configured, stream_of
from sequences import BEARINGS
from true_bearing import TrueBearing

from stickslip_monitor import Monitor, MonitorConfig
from stickslip_monitor.monitor.alarm_list import ON_SHOW, Action
from stickslip_monitor.monitor.alarm_records import ActionRequest
from stickslip_monitor.monitor.alarm_states import RUNG_OF, AlarmKind
from stickslip_monitor.monitor.sample_types import Input
from stickslip_monitor.monitor.severity import LADDER

STEP = 0.2
LENGTH, CALM = 320.0, 100.0
"""How long a run is up to its manoeuvres, and how long there are no faults before these [s]: a
condition that flickered is held for six off-delays, of 10 s each, and the end of stick-slip waits
for one more."""
DURATION = LENGTH + manoeuvres.DURATION
"""How long a run is at most, without hold-ups [s]."""
TIMEOUT = 5.0
"""Of speed and load, the default [s]."""
SETTLED = 60.0
"""So long after a change of the truth something else may be told [s]."""
SHARES = (0.4, -0.4, 1.6, 2.5, -2.5, 0.0)
"""Speeds in fold speeds: below the Hopf speed, beyond the fold, at rest."""
RAMPS = (0.0, 0.0, 5.0, 30.0)
"""Durations of a change of speed under faults [s]."""
SECOND_SHARE = 2.5
"""What a second publisher of the speed sends, in fold speeds."""
NO_VALUE = (float('nan'), -9999.0, -999.25, 32767.0, 65535.0, 1e20)
NAMES = ('aft', 'forward')
PAIRS = (('reference', 'ship'), ('steep', 'viscous'), ('ship', 'steep'), ('viscous', 'reference'))
KINDS: dict[str, dict[str, float]] = {
    'plain': {},
    'tolerance': {'tolerance.damping': 0.05, 'tolerance.decay': 0.05},
    'limit': {'alarm.amplitude_limit': 1e-6},
}
"""Parameters of both bearings beside their delays."""
RATES = {
    'lost': 0.05,
    'late': 0.05,
    'delayed': 0.05,
    'doubled': 0.02,
    'no value': 0.02,
    'far stamp': 0.01,
    'pause': 0.002,
    'clock set': 0.002,
    'held up': 0.002,
    'kill': 0.001,
    'act': 0.01,
    'retune': 0.001,
    'level dies': 0.001,
}
"""How often each fault happens: of a message, or at a step of :data:`STEP`."""
ON_THE_WAY = ('lost', 'late', 'delayed', 'doubled', 'no value', 'far stamp', 'pause', 'level dies')
"""Faults that a recording shows as they are: with these alone it tells the same changes."""


@cache
def configuration(
    pair: tuple[str, str], kind: str, on_delay: float = 2.0, off_delay: float = 10.0, latch: bool = False
) -> MonitorConfig:
    """Return the configuration of two bearings, the second with a level."""
    alarm = {'alarm.on_delay': on_delay, 'alarm.off_delay': off_delay, 'alarm.latch': latch}
    level = {'level.topic': '/v', 'level.unit': 'dB', 'level.threshold': 34.0}
    parts = [
        configured(name, BEARINGS[bearing][0] | alarm | KINDS[kind] | more)
        for name, bearing, more in zip(NAMES, pair, ({}, level), strict=True)
    ]
    return MonitorConfig(bearings=tuple(part.bearings[0] for part in parts))


@dataclass
class Sender:
    """Sender of one input: its pace, how evenly, and its clock."""

    name: str
    place: Input
    period: float
    uneven: float  # in shares of the period
    ahead_ns: int  # of the true time
    whole: bool  # stamps in whole seconds
    second: bool = False  # a second publisher, which sends while manoeuvres want it
    due: float = 0.0

    def stamp(self, true_ns: int) -> int:
        """Return the stamp of its clock for a true time."""
        clock_ns = true_ns + self.ahead_ns
        return clock_ns - clock_ns % SECOND if self.whole else clock_ns


@dataclass
class Outcome:
    """Result of a run."""

    seed: int
    wrong: Counter[str] = field(default_factory=Counter)  # seconds told for the truth
    settled: int = 0  # seconds looked at
    sounds: int = 0  # how often a bearing began to sound in its manoeuvres
    faults: list[str] = field(default_factory=list)  # what is not as it should be without faults

    @property
    def misled(self) -> int:
        """Seconds in which stick-slip was hidden, or reported without being there."""
        return sum(
            count
            for pair, count in self.wrong.items()
            if set(pair.split(' for ')) & {'normal'} and set(pair.split(' for ')) & set(STICKING)
        )


class Run:
    """One run.

    Args:
        seed: Its seed.
    """

    def __init__(self, seed: int) -> None:
        self.outcome, self.random = Outcome(seed), random.Random(seed)
        draw = self.random.random
        self.rates = {name: rate * (draw() < 0.5) for name, rate in RATES.items()}
        if draw() < 0.5:
            self.rates |= dict.fromkeys(RATES.keys() - set(ON_THE_WAY), 0.0)
        self.recorded = not any(self.rates[name] for name in RATES.keys() - set(ON_THE_WAY))
        choose = self.random.choice
        self.own = choose(PAIRS), choose(('plain', 'plain', 'plain', *KINDS))
        self.sticks = 'amplitude_limit' if self.own[1] == 'limit' else 'stick_slip'
        self.bearings = dict(zip(NAMES, self.own[0], strict=True))
        self.ship = Ship(configuration(*self.own))
        self.time, self.calm, self.deaf = 0.0, False, False
        self.truth = {name: TrueBearing(bearing, 1.6) for name, bearing in self.bearings.items()}
        self.manoeuvres = {name: Manoeuvres(name, truth) for name, truth in self.truth.items()}
        self.senders = [
            self._make_sender(name, place)
            for name in NAMES
            for place in (Input.SPEED, Input.LOAD, Input.LEVEL)
        ]
        del self.senders[2]  # the first bearing has no level
        # Twice as often as the first, with its clock.
        self.senders += [
            replace(sender, period=sender.period / 2.0, second=True)
            for sender in self.senders
            if sender.place is Input.SPEED
        ]
        self.waiting: list[tuple[float, int, Sender, int, float]] = []
        self.delivered: dict[str, list[Message]] = {name: [] for name in NAMES}
        self.sent, self.held = 0, 0.0
        # When each input brought a value last, and the longest that one brought none, but for
        # hold-ups, by bearing [s].
        self.heard: dict[tuple[str, Input], float] = {}
        self.silent = dict.fromkeys(NAMES, 0.0)

    def _make_sender(self, name: str, place: Input) -> Sender:
        choose = self.random.choice
        ahead = choose((0, 0, 0, -300, 5, 3600)) * SECOND
        return Sender(
            name, place, choose((0.2, 0.5, 1.0)), choose((0.0, 0.8)), ahead, choose((False, False, True))
        )

    def happens(self, fault: str) -> bool:
        return not self.calm and self.random.random() < self.rates[fault]

    def go(self) -> Outcome:
        """Sail to the end."""
        for step in range(round(LENGTH / STEP)):
            if self.time > LENGTH - CALM and not self.calm:
                self._calm_down()
            elif not self.calm and self.random.random() < 0.002:
                name = self.random.choice(NAMES)
                middle = self.truth[name].middle
                self._steer_randomly(name, (*SHARES, middle, middle), self.random.choice(RAMPS))
            self._take_step()
            if step % 5 == 0:
                self._compare_conditions()
        self._judge_end()
        self._sail_manoeuvres()
        return self.outcome

    def _take_step(self) -> None:
        """Let a step of time pass, with all that is sent and happens in it."""
        self._pass_time(STEP)
        for sender in self.senders:
            self._send_due(sender)
        self._cause_trouble()
        self._deliver_waiting()
        self.ship.tick()

    def _pass_time(self, seconds: float) -> None:
        self.time += seconds
        self.ship.steady_ns += round(seconds * SECOND)
        for truth in self.truth.values():
            truth.pass_time(seconds)

    def _true_condition(self, name: str) -> str:
        condition = self.truth[name].condition()
        return self.sticks if condition == 'stick_slip' else condition

    def _steer_randomly(self, name: str, shares: Sequence[float], seconds: float) -> None:
        self.truth[name].steer(self.random.choice(shares), seconds)

    def _calm_down(self) -> None:
        self.calm, self.deaf, self.ship.full = True, False, ''
        for name in NAMES:
            self._steer_randomly(name, SHARES, 0.0)
        for action in (Action.UNSHELVE, Action.RESTORE):
            self.ship.session.act(ActionRequest(action, 'Ada'))

    def _sail_manoeuvres(self) -> None:
        """Sail the manoeuvres of both bearings, and judge what is shown meanwhile."""
        under_way = {name: manoeuvre.sail() for name, manoeuvre in self.manoeuvres.items()}
        while under_way:
            self._take_step()
            alarms = self.ship.published[-1]['alarms']
            for name, manoeuvre in self.manoeuvres.items():
                sounding, active = (
                    frozenset(a['alarm'] for a in alarms if a['bearing'] == name and a[state])
                    for state in ('sounding', 'active')
                )
                manoeuvre.take(Report(self.time, self._reported_condition(name), sounding, active))
            under_way = {name: steps for name, steps in under_way.items() if next(steps, self) is None}
            for name, manoeuvre in self.manoeuvres.items():
                if manoeuvre.acknowledges:
                    self.ship.session.act(ActionRequest(Action.ACKNOWLEDGE, 'Ada', name))
        for manoeuvre in self.manoeuvres.values():
            self.outcome.sounds += manoeuvre.sounds
            self.outcome.faults += manoeuvre.faults

    def _send_due(self, sender: Sender) -> None:
        """Send what is due; a second publisher may send several values in a step."""
        if sender.second and not self.manoeuvres[sender.name].mixed:
            sender.due = self.time
        while sender.due < self.time:
            self._send_one(sender, sender.due if sender.second else self.time)

    def _send_one(self, sender: Sender, time: float) -> None:
        draw = self.random.uniform
        sender.due = time + sender.period * draw(1.0 - sender.uneven, 1.0 + sender.uneven)
        if self.happens('pause'):
            sender.due += draw(3.0, 40.0)
        if self.happens('lost'):
            return
        true_ns = T0 + round(time * SECOND)
        if self.happens('late'):
            true_ns -= round(draw(0.0, 0.4) * SECOND)
        stamp = sender.stamp(true_ns)
        if self.happens('far stamp'):
            stamp += self.random.choice((-3600, 3600, -8)) * SECOND
        arrival = time + (draw(0.0, 2.0) if self.happens('delayed') else 0.0)
        for _ in range(2 if self.happens('doubled') else 1):
            self.sent += 1
            heapq.heappush(self.waiting, (arrival, self.sent, sender, stamp, self._measured_value(sender)))

    def _measured_value(self, sender: Sender) -> float:
        if self.happens('no value'):
            return self.random.choice(NO_VALUE)
        truth = self.truth[sender.name]
        noise = 1.0 + self.random.gauss(0.0, 0.005)
        if sender.place is Input.LEVEL:
            return 1.0 if self.deaf else noise * (46.0 if truth.sticks else 22.0)
        share = SECOND_SHARE if sender.second else truth.share
        return noise * (share * truth.fold_rpm if sender.place is Input.SPEED else truth.load)

    def _deliver_waiting(self) -> None:
        while self.waiting and self.waiting[0][0] <= self.time:
            _, _, sender, stamp, value = heapq.heappop(self.waiting)
            arrival = (self.ship.now.time_ns - T0) / SECOND
            message = Message(arrival, sender.place, (stamp - T0) / SECOND, value)
            self.delivered[sender.name].append(message)
            self.ship.take(sender.name, sender.place, value, stamp)
            if not (value in NO_VALUE or math.isnan(value) or sender.place is Input.LEVEL):
                key, now = (sender.name, sender.place), self.time - self.held
                silent = now - self.heard.get(key, 0.0)
                self.heard[key] = now
                self.silent[sender.name] = max(self.silent[sender.name], silent)

    def _cause_trouble(self) -> None:
        """Let the clock jump, the computer stall and people act at random."""
        choose, ship = self.random.choice, self.ship
        self.deaf |= self.happens('level dies')
        if self.happens('clock set'):
            ship.ahead_ns += choose((-3600, -5, 7, 86400)) * SECOND
        if self.happens('held up'):
            self._pass_time(8.0)
            self.held += 8.0
            ship.session.discount_stall(8 * SECOND)
        if self.happens('retune'):
            delays = choose((0.0, 2.0)), choose((5.0, 10.0))
            ship.config = configuration(*self.own, *delays, choose((False, True)))
            ship.session.retune(ship.config)
        if self.happens('act'):
            kind, name = choose((None, *AlarmKind)), choose((None, *NAMES))
            ship.session.act(ActionRequest(choose(list(Action)), 'Ada', name, kind))
            ship.full = choose(('', '', 'No space left on device'))
        if self.happens('kill'):
            ship.kept = ship.kept[: choose((None, None, None, 100))]
            ship.boot()

    def _reported_condition(self, name: str) -> str:
        return str(self.ship.session.monitor.condition(name))

    def _compare_conditions(self) -> None:
        for name in NAMES:
            if self.calm or self.time - self.truth[name].settled_at < SETTLED:
                continue
            reported, truth = self._reported_condition(name), self._true_condition(name)
            self.outcome.settled += 1
            self.outcome.wrong[f'{reported} for {truth}'] += reported != truth

    def _judge_end(self) -> None:
        say = self.outcome.faults.append
        for name in NAMES:
            reported, truth = self._reported_condition(name), self._true_condition(name)
            if reported != truth:
                say(f'{name}: {reported} is told, {truth} is true')
            self._judge_alarms(name, truth)
            offline = self._offline_conditions(name)
            if offline[-1:] != [truth] and (offline or truth != 'normal'):
                say(f'{name}: of what was delivered {offline[-1:]} is told, {truth} is true')
            live = [str(event.after) for event in self.ship.events if event.bearing == name]
            if self.recorded and live != offline:
                say(f'{name}: live {live}, of what was delivered {offline}')
            # A stamp far ahead makes those after it older than the newest for some time.
            blamed = 'input_stale' in live and not self.rates['far stamp']
            if blamed and self.silent[name] < TIMEOUT - 1.0:
                say(f'{name}: an input is lost, and none was silent')

    def _judge_alarms(self, name: str, truth: str) -> None:
        rung = next(k for k, condition in enumerate(LADDER) if condition == truth)
        for kind, alarm in self.ship.session.annunciator.alarms[name].items():
            expected = kind in RUNG_OF and RUNG_OF[kind] <= rung
            if alarm.active != expected or (expected and alarm.state not in ON_SHOW):
                self.outcome.faults.append(
                    f'{name}: {kind} is {alarm.state}, active: {alarm.active}; true: {truth}'
                )

    def _offline_conditions(self, name: str) -> list[str]:
        """Return the conditions by the messages as they were delivered."""
        stream = stream_of(self.delivered[name], T0)
        end_ns = self.ship.now.time_ns
        scan = Monitor(self.ship.config).scan({name: stream}, T0, end_ns)[name]
        return [str(event.after) for event in scan.events]


def run(seed: int) -> Outcome:
    """Return the outcome of a seed."""
    return Run(seed).go()


def runs(seeds: range, jobs: int) -> Iterator[Outcome]:
    """Yield the outcomes of some seeds, in their order."""
    if jobs == 1:
        yield from map(run, seeds)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(run, seeds, chunksize=10)


def repeated_by(seed: int) -> str:
    """Return the command that repeats a run."""
    return f"make simulate SIMULATE_ARGS='--seed {seed}'"
