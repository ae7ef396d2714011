# SPDX-License-Identifier: Apache-2.0
"""Errors of clocks and recorder: jitter, jumps, disorder, repeats, losses, another sender, cuts.

A jump shifts all later stamps; several add up. Without a header a message's stamp is the
recorder's own time, by which readers sort: such a topic can jump forward only, and cannot be out
of order. After a cut nothing is written: the file ends within its last chunk, without its index,
and a folder has no metadata.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from stickslip_monitor.errors import SceneError
from stickslip_monitor.lab.scenes.effects.effect import (
    SceneRun,
    channel_effect,
    effect,
    require_header,
    sensor_effect,
    unit_of,
)
from stickslip_monitor.lab.scenes.effects.sensor import Change
from stickslip_monitor.lab.scenes.profile import check_points, read_sample_mask
from stickslip_monitor.lab.scenes.settings import Settings
from stickslip_monitor.lab.scenes.shaft import TimeBlock
from stickslip_monitor.lab.scenes.telemetry import Channel, Signal
from stickslip_monitor.monitor.signals import INPUTS

# Jitter beyond this is none any more; a jump is not beyond ten years [s].
_MOST_JITTER, _LONGEST_JUMP = 10.0, 3.2e8


@sensor_effect('recording', 'the jitter', 'standard_deviation')
def clock_jitter(settings: Settings, channel: Channel, run: SceneRun) -> Change:
    """Scatters the stamps; none comes to lie before 1970."""
    deviation = settings.number('standard_deviation', 's', least=0.0, most=_MOST_JITTER)
    random = run.random(settings, channel)

    def shift(signal: Signal) -> None:
        off = random.standard_normal(signal.stamp_ns.size) * (deviation * 1e9)
        signal.stamp_ns += np.rint(off).astype(np.int64)
        np.maximum(signal.stamp_ns, 0, out=signal.stamp_ns)

    return shift


@channel_effect('recording', INPUTS, 'jumps')
def clock_jump(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Shifts all stamps after each jump."""
    jumps = _jumps(settings, run.duration)
    if any(by < 0.0 for _, by in jumps):
        require_header(channel, 'its clock can only jump forward')
    times = np.array([time for time, _ in jumps])
    shifts_ns = np.cumsum([0, *(round(by * 1e9) for _, by in jumps)])
    edges = [*times.tolist(), run.duration]
    for number, (begin, end) in enumerate(pairwise(edges), 1):
        first, last = (
            run.start_ns + int(shifts_ns[number]) + round(time * 1e9) for time in (begin, end)
        )
        if first < 0 or last >= channel.stamps_end_ns:
            raise SceneError(
                f'{settings.label("jumps")}: jump {number} takes the clock out of the range of'
                ' time stamps: from 1970, in headers to 2038, else to 2262'
            )

    def shift_stamps(signal: Signal) -> None:
        signal.stamp_ns += shifts_ns[np.searchsorted(times, signal.time, side='right')]

    run.effects.append(lambda block: shift_stamps(block.signals[channel.topic]))


def _jumps(settings: Settings, duration: float) -> list[tuple[float, float]]:
    """When the clock jumps [s], and by how much [s]."""
    rows = settings.rows('jumps', 'jump', 'a list of jumps [time in s, value in s]')
    jumps = check_points(rows, duration)
    for (name, _), (_, by) in zip(rows, jumps, strict=True):
        if not 0.0 < abs(by) <= _LONGEST_JUMP:
            rule = f'which must not be 0 nor beyond {_LONGEST_JUMP:g} s'
            raise SceneError(f'{name} is by {by:g} s, {rule}')
    return jumps


@sensor_effect('recording', 'which messages arrive late', 'delay', 'windows', 'share')
def out_of_order(settings: Settings, channel: Channel, run: SceneRun) -> Change:
    """Delays some messages."""
    require_header(channel, 'none of its messages can be out of order')
    # A shorter delay overtakes nothing.
    delay = settings.number('delay', 's', above=1.0 / channel.rate, most=60.0)
    delay_ns = round(delay * 1e9)
    mask = read_sample_mask(settings, run.duration, run.random(settings, channel))

    def hold_up(signal: Signal) -> None:
        assert signal.arrival_ns is not None  # it has a header
        signal.arrival_ns[mask.hit(signal.time)] += delay_ns

    return hold_up


@sensor_effect('recording', 'which messages come twice', 'windows', 'share')
def repeated_stamps(settings: Settings, channel: Channel, run: SceneRun) -> Change:
    """Records some messages twice."""
    mask = read_sample_mask(settings, run.duration, run.random(settings, channel))

    def repeat(signal: Signal) -> None:
        signal.counted()[mask.hit(signal.time)] *= 2

    return repeat


@sensor_effect('recording', 'which messages are lost', 'windows', 'share')
def dropout(settings: Settings, channel: Channel, run: SceneRun) -> Change:
    """Loses some messages."""
    mask = read_sample_mask(settings, run.duration, run.random(settings, channel))

    def lose(signal: Signal) -> None:
        signal.counted()[mask.hit(signal.time)] = 0

    return lose


@sensor_effect('recording', 'what it sends', 'value', 'unit', 'rate')
def second_publisher(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Sends a constant value on the same topic, between the regular instants of its rate."""
    unit, factor = unit_of(settings, channel)
    value = settings.number('value', unit) * factor
    rate = settings.number('rate', 'Hz', above=0.0, most=1000.0)

    def join(block: TimeBlock) -> None:
        halves = block.instants(2.0 * rate)
        time = halves[np.rint(halves * (2.0 * rate)).astype(np.int64) % 2 == 1]
        stamp = run.start_ns + np.rint(time * 1e9).astype(np.int64)
        more = {'time': time, 'stamp_ns': stamp, 'arrival_ns': stamp}
        more |= {'value': np.full(time.size, value), 'copies': np.ones_like(stamp)}
        signal = block.signals[channel.topic]
        order = np.argsort(np.concatenate([signal.time, time]), kind='stable')
        for name, own in more.items():
            if (known := getattr(signal, name)) is not None:
                setattr(signal, name, np.concatenate([known, own])[order])

    run.effects.append(join)


@effect('file', 'time')
def cut_off(settings: Settings, run: SceneRun) -> None:
    """Ends the recorder in mid-write."""
    run.claim(settings.name)
    run.cut = settings.number('time', 's', above=0.0, most=run.duration)
