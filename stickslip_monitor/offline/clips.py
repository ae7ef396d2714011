# SPDX-License-Identifier: Apache-2.0
"""A folder of event clips: small MCAP files, the oldest of which make room for the newest."""

from __future__ import annotations

import contextlib
import itertools
import re
import time
from collections.abc import Iterator, Sequence
from datetime import datetime, timedelta, timezone
from pathlib import Path

from stickslip_monitor.bags.encode import MESSAGE_TYPES
from stickslip_monitor.bags.values import TimeSpans
from stickslip_monitor.bags.writer import BagWriter, is_labelled
from stickslip_monitor.errors import BagError
from stickslip_monitor.monitor.clip_recorder import Clip, ClipMessage, ClipRecorder, begins_clip
from stickslip_monitor.monitor.config import ClipConfig, MonitorConfig
from stickslip_monitor.offline.check import CheckReport
from stickslip_monitor.offline.verdict_bag import NODE, MessageColumn, tell_verdicts, topics

_SLICE = 500
# Written in the file, so that a recording of somebody else is none of ours, whatever its name.
_LABEL = 'stickslip_monitor/clip'
_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)
_NAME = r'\d{8}T\d{6}Z_[a-z0-9_]+(-\d+)?\.mcap'
_OURS, _DRAFT = re.compile(_NAME), re.compile(rf'\.{_NAME}\.\d+\.draft')
# Another monitor may be writing into the folder [s].
_STALE = 3600.0


class ClipFolder:
    """Writes clips into a folder and keeps the newest of them.

    Args:
        config: The folder, and how many clips it holds.

    Raises:
        BagError: The folder is not there and cannot be made.
    """

    def __init__(self, config: ClipConfig) -> None:
        self.path = Path(config.directory).expanduser()
        self._most = config.most
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise BagError(
                f"clips.directory = '{config.directory}' cannot be made: {error.strerror or error}"
            ) from error
        self._sweep()

    def write(self, clip: Clip) -> Iterator[None]:
        """Write a clip, some messages at each step; then drop the oldest that are too many.

        Raises:
            BagError: It cannot be written; nothing of it stays.
        """
        with BagWriter(self._free(clip), label=_LABEL) as writer:
            known: set[str] = set()
            for number, message in enumerate(clip.messages, 1):
                if message.topic not in known:
                    known.add(message.topic)
                    kind = message.type
                    own = None if kind in MESSAGE_TYPES else clip.definitions.get(kind)
                    writer.add_topic(message.topic, kind, own)
                writer.write(message.topic, message.time_ns, message.data)
                if number % _SLICE == 0:
                    yield
        self._drop_oldest()

    def clips(self) -> list[Path]:
        """The clips of the folder, the oldest first.

        A clip has a name and a label of ours: one that was renamed is somebody's to keep.
        """
        found = []
        for path in self.path.iterdir():
            if _OURS.fullmatch(path.name) and is_labelled(path, _LABEL):
                with contextlib.suppress(FileNotFoundError):
                    found.append((path.stat().st_mtime_ns, path.name, path))
        return [path for *_, path in sorted(found)]

    def _free(self, clip: Clip) -> Path:
        """A name that is not taken: when, which bearing, what."""
        when = _EPOCH + timedelta(seconds=clip.time_ns // 10**9)
        stem = f'{when:%Y%m%dT%H%M%SZ}_{clip.bearing}_{clip.condition.value}'
        for number in itertools.count(1):
            path = self.path / f'{stem}{f"-{number}" if number > 1 else ""}.mcap'
            if not path.exists():
                return path
        raise AssertionError('unreachable: the numbers do not end')

    def _sweep(self) -> None:
        """Remove what a crash left of clips that were being written."""
        for path in self.path.iterdir():
            if not _DRAFT.fullmatch(path.name) or not path.is_file():
                continue
            state = path.stat()
            ours = state.st_size == 0 or is_labelled(path, _LABEL)
            if ours and time.time() - state.st_mtime > _STALE:
                path.unlink(missing_ok=True)

    def _drop_oldest(self) -> None:
        for path in self.clips()[: -self._most]:
            with contextlib.suppress(FileNotFoundError):
                path.unlink()


def write_clips(checked: CheckReport, config: MonitorConfig, store: ClipFolder) -> int:
    """Write a clip of every alarm in a checked bag, and return how many there were.

    Args:
        checked: What the check found.
        config: The configuration it was checked with.
        store: Where to.

    Raises:
        BagError: One cannot be written, or the bag cannot be read again.
    """
    definitions = {kind: text for _, kind, text in topics(checked, config) if text is not None}
    recorder = ClipRecorder(config.clips, definitions)
    events = [event for bearing in checked.bearings.values() for event in bearing.events]
    events.sort(key=lambda event: event.time_ns)
    around = config.clips.around_ns
    alarms = [event.time_ns for event in events if begins_clip(event)]
    spans = TimeSpans((time_ns - around, time_ns + around) for time_ns in alarms)
    raised = iter([event for event in events if spans.overlap(event.time_ns, event.time_ns)])
    count = 0

    def store_clips() -> None:
        nonlocal count
        for clip in recorder.clips():
            for _ in store.write(clip):
                pass
            count += 1

    def take(columns: Sequence[MessageColumn]) -> None:
        for message in _in_order(columns):
            recorder.add(message)
            if message.topic == f'/{NODE}/warnings':
                recorder.note(next(raised))
            store_clips()

    tell_verdicts(checked, config, take, spans)
    recorder.finish()
    store_clips()
    return count


def _in_order(columns: Sequence[MessageColumn]) -> list[ClipMessage]:
    found = []
    for topic, kind, time_ns, payload in columns:
        found += [
            ClipMessage(t, topic, kind, d) for t, d in zip(time_ns.tolist(), payload, strict=True)
        ]
    return sorted(found, key=lambda message: message.time_ns)
