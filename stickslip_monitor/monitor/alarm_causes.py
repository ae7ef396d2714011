# SPDX-License-Identifier: Apache-2.0
"""The causes of a bearing's alarms: which are present, suppressed, or part of a manoeuvre that is known.

The ladder's thresholds and delays are the rule's, whose events are taken as they come. What the ladder does
not know (an input that comes and goes, absurd values, a shaft that starts to turn) has its delays here.
"""

from __future__ import annotations

from collections.abc import Set

from stickslip_logs.units import SECOND_NS
from stickslip_monitor.monitor.alarm_states import RUNG_OF, SUPPRESSIBLE, AlarmKind
from stickslip_monitor.monitor.parameters import BearingConfig
from stickslip_monitor.monitor.sample_types import INPUTS
from stickslip_monitor.monitor.severity import LADDER, Condition
from stickslip_monitor.monitor.statements import Event

LASTING_NS = 15 * SECOND_NS
"""Stick-slip that comes again within ten minutes of its sound sounds once it has lasted so long, of a
manoeuvre that somebody has acknowledged so much longer than what was acknowledged [ns]: a kick ahead or
a reversal is over by then (docs/rule.md)."""
MANOEUVRE_NS = 120 * SECOND_NS
"""Stick-slip that begins within this time of the one before is of one manoeuvre [ns] (docs/rule.md)."""
AT_REST, START_UP = 'at_rest', 'start_up'
"""Why alarms are suppressed by design."""


class Causes:
    """The causes of one bearing's alarms; ``now_ns`` is a running time that never goes back [ns].

    Conditions that are recalled held before a restart: they hold until the bearing has been watched for long
    enough to know. ``texts`` are the latest of each condition, for a person.
    """

    def __init__(self, config: BearingConfig, recalled: Set[AlarmKind] = frozenset()) -> None:
        self.config, self.recalled = config, recalled
        self.texts: dict[AlarmKind, str] = {}
        self._recalled_until: int | None = None
        self._condition = Condition.NORMAL  # of the operating point
        self._lost, self._lost_until = False, 0
        self._implausible, self._implausible_last = False, 0
        self._implausible_since: int | None = None
        self._resting = self._resting_asked = False
        self._resting_since = self._start_up_until = 0
        self.sticking_ns = 0  # for how long stick-slip has been predicted with the shaft turning
        self._turning_since: int | None = None  # the last point, if stick-slip was predicted there
        self._ended_ns: int | None = None  # when stick-slip was predicted last, with the shaft turning
        self._longest_ns = 0  # the longest stick-slip of this manoeuvre, with the shaft turning
        self._acknowledged_ns = 0  # the same when somebody acknowledged it last; 0 where nobody has
        self.is_acknowledged = False  # somebody has acknowledged the stick-slip that runs

    def restore_condition(self, condition: Condition) -> None:
        """Set the condition of the bearing to the one before a restart."""
        self._lost = condition is Condition.INPUT_STALE
        self._condition = Condition.NORMAL if self._lost else condition

    def is_present(self, kind: AlarmKind) -> bool:
        """Return whether the cause of a kind of alarm is present; one held after a restart counts."""
        if kind in RUNG_OF:
            is_reached = LADDER.index(self._condition) >= RUNG_OF[kind]
        elif kind is AlarmKind.VIBRATION:
            is_reached = self._condition is Condition.VIBRATION
        elif kind is AlarmKind.INPUT_LOST:
            is_reached = self._lost or self._lost_until > 0
        else:
            is_reached = self._implausible
        return is_reached or kind in self.recalled

    @property
    def recovery_times(self) -> tuple[int, int] | None:
        """Running times [ns] at which lost inputs came back, and at which their alarm clears.

        ``None`` where no input has come back within its off-delay.
        """
        until = self._lost_until
        return (until - self.config.alarm.input_off_delay_ns, until) if until else None

    def suppression_reasons(self, kind: AlarmKind, now_ns: int) -> list[str]:
        """Return ``at_rest``, ``start_up`` or both where they suppress this kind now; else an empty list."""
        if kind not in SUPPRESSIBLE:
            return []
        reasons = {AT_REST: self._resting, START_UP: now_ns < self._start_up_until}
        return [reason for reason, holds in reasons.items() if holds]

    def take_event(self, event: Event, now_ns: int) -> None:
        """Update condition, lost input and texts by a change of the bearing's condition or an onset.

        An onset takes back that the running stick-slip is acknowledged.
        """
        if event.after is Condition.INPUT_STALE:
            self._lost, self._lost_until = True, 0
            self.texts[AlarmKind.INPUT_LOST] = event.text
            return
        if event.before is Condition.INPUT_STALE:
            delay = self.config.alarm.input_off_delay_ns
            self._lost, self._lost_until = False, now_ns + delay if delay else 0
        self.is_acknowledged &= not event.onset
        before, self._condition = LADDER.index(self._condition), event.after
        now, text = LADDER.index(event.after), event.condition_text
        if event.after is Condition.VIBRATION:
            self.texts[AlarmKind.VIBRATION] = text
        for kind, rung in RUNG_OF.items():
            if before < rung <= now or rung == now:
                self.texts[kind] = text

    def take_fault(self, place: int, fault: str, now_ns: int) -> None:
        """Count a sample with an invalid value, or one of two mixed sources, and write the text of its alarm.

        One such value is a glitch: the cause of ``input_implausible`` is present when they keep coming,
        within the off-delay of one another, for the on-delay. It is gone after the inputs' own off-delay.

        Args:
            place: Index of the input in :data:`.sample_types.INPUTS`.
            fault: What is wrong with the value, as a clause.
            now_ns: The running time [ns].
        """
        self._update_implausible(now_ns)
        if self._implausible_since is None:
            self._implausible_since = now_ns
        self._implausible_last = now_ns
        self._implausible |= now_ns - self._implausible_since >= self.config.alarm.on_delay_ns
        topic = self.config.inputs[INPUTS[place]].topic
        self.texts[AlarmKind.INPUT_IMPLAUSIBLE] = (
            f'{self.config.name}: Input {INPUTS[place]} implausible: on {topic}, {fault}.'
        )

    def recall(self, kinds: Set[AlarmKind], now_ns: int) -> None:
        """Let some causes, and those recalled before, count as present from a running time [ns] on.

        That lasts for the on-delay and the off-delay together.
        """
        alarm = self.config.alarm
        self.recalled = self.recalled | kinds
        self._recalled_until = now_ns + alarm.on_delay_ns + alarm.off_delay_ns

    def take_point(self, now_ns: int, *, resting: bool, sticking: bool) -> bool:
        """Take an operating point: count the time of stick-slip, and note rest.

        The first one after a restart begins the time for which the causes in ``recalled`` count as present.

        Args:
            now_ns: The running time [ns].
            resting: Whether the shaft is at rest there.
            sticking: Whether stick-slip is predicted there.

        Returns:
            Whether the shaft has just come to rest or started to turn, so that the alarms have to be updated.
        """
        self._count_sticking(now_ns, resting=resting, sticking=sticking)
        if self.recalled and self._recalled_until is None:
            self.recall(self.recalled, now_ns)
        if resting != self._resting_asked:
            self._resting_asked, self._resting_since = resting, now_ns
        return self._update_rest(now_ns)

    def _count_sticking(self, now_ns: int, *, resting: bool, sticking: bool) -> None:
        """Add the time since the last point to that of stick-slip with the shaft turning; 0 once it ended.

        A pause that is long enough begins another manoeuvre, of which nothing is acknowledged.

        ``resting``: the shaft is at rest at this point; ``sticking``: stick-slip is predicted there.
        """
        if self._turning_since is not None:
            self.sticking_ns += now_ns - self._turning_since
            self._longest_ns = max(self._longest_ns, self.sticking_ns)
        if not sticking:
            self.sticking_ns = 0
        elif not resting:
            if not self.is_in_manoeuvre(now_ns):
                self._longest_ns = self._acknowledged_ns = 0
            self._ended_ns = now_ns
        self._turning_since = now_ns if sticking and not resting else None

    def is_in_manoeuvre(self, now_ns: int) -> bool:
        """Return whether stick-slip was predicted within the last two minutes, with the shaft turning."""
        return self._ended_ns is not None and now_ns - self._ended_ns < MANOEUVRE_NS

    def is_acknowledged_before(self, now_ns: int) -> bool:
        """Return whether a person has acknowledged stick-slip of the manoeuvre that still goes on."""
        return self._acknowledged_ns > 0 and self.is_in_manoeuvre(now_ns)

    @property
    def is_lasting(self) -> bool:
        """Whether stick-slip has lasted long enough to sound again: 15 s beyond what was acknowledged.

        Never while the stick-slip that runs is acknowledged.
        """
        return self.sticking_ns >= self._acknowledged_ns + LASTING_NS and not self.is_acknowledged

    def acknowledge(self, *, is_active: bool) -> None:
        """Record that a person has acknowledged an alarm of stick-slip, with the longest stick-slip so far.

        ``is_active``: its cause is still present, so it is the running stick-slip that was acknowledged.
        """
        self._acknowledged_ns, self.is_acknowledged = self._longest_ns, is_active

    def advance(self, now_ns: int) -> None:
        """Let the running time pass to ``now_ns`` [ns] without a sample.

        Lost inputs, held causes, faults and rest may end by it.
        """
        if now_ns >= self._lost_until:
            self._lost_until = 0
        if self._recalled_until is not None and now_ns >= self._recalled_until:
            self.recalled, self._recalled_until = frozenset(), None
        self._update_implausible(now_ns)
        self._update_rest(now_ns)

    def _update_implausible(self, now_ns: int) -> None:
        """End the cause of ``input_implausible``, or its count, after its off-delay without a fault."""
        alarm = self.config.alarm
        delay = alarm.input_off_delay_ns if self._implausible else alarm.off_delay_ns
        if now_ns - self._implausible_last >= delay:
            self._implausible, self._implausible_since = False, None

    def _update_rest(self, now_ns: int) -> bool:
        """Set whether the shaft is at rest (after the off-delay) or turns (after the on-delay).

        Returns:
            Whether that has changed; start-up begins where the shaft starts to turn.
        """
        alarm, resting = self.config.alarm, self._resting_asked
        delay = alarm.off_delay_ns if resting else alarm.on_delay_ns
        if resting == self._resting or now_ns - self._resting_since < delay:
            return False
        self._resting = resting
        if not resting:
            self._start_up_until = now_ns + alarm.startup_inhibit_ns
        return True
