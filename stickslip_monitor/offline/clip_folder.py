# SPDX-License-Identifier: Apache-2.0
"""A folder of event clips: small MCAP files, the oldest of which make room for the newest."""

from __future__ import annotations

import contextlib
import itertools
import re
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import timedelta
from pathlib import Path

import numpy as np

from stickslip_logs.recordings.recording import Recording, TimeSpans
from stickslip_logs.recordings.writer import BagWriter, is_labelled
from stickslip_logs.time_order import EPOCH
from stickslip_monitor.errors import BagError, cause
from stickslip_monitor.monitor.clip_recorder import Clip, ClipMessage, ClipRecorder, begins_clip
from stickslip_monitor.monitor.parameters import ClipConfig, MonitorConfig
from stickslip_monitor.offline.check import Stretch, StretchSink, pays_to_compile
from stickslip_monitor.offline.verdict_messages import (
    NODE,
    MessageColumn,
    VerdictMessages,
    columns_of,
    events_of,
    input_topics,
    topics,
)

# Written in the file: a recording of somebody else is not taken for a clip by its name.
_LABEL = 'stickslip_monitor/clip'
_NAME = r'\d{8}T\d{6}Z_[a-z0-9_]+(-\d+)?\.mcap'
_OURS, _DRAFT = re.compile(_NAME), re.compile(rf'\.{_NAME}\.[0-9a-f]+\.draft')


class ClipFolder:
    """Writes clips into a folder and keeps the newest of them; made if it is not there.

    Drafts that were left there over an hour ago are removed at once.

    Args:
        config: The folder, and how many clips it holds.

    Raises:
        BagError: The folder cannot be made or read, or an old draft cannot be removed.
    """

    def __init__(self, config: ClipConfig) -> None:
        self.path = Path(config.directory).expanduser()
        self._is_new = not self.path.exists()
        self._max_clips = config.most
        self.removed = 0
        """How many clips have made room for newer ones."""
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self._remove_drafts()
        except OSError as error:
            raise BagError(
                f"clips.directory = '{config.directory}' cannot be used: {cause(error)};"
                ' name a folder in which this user may write'
            ) from error

    def __enter__(self) -> ClipFolder:
        """Return the folder itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Leave no empty folder behind where an error or a signal came before the first clip."""
        if kind is not None and self._is_new:
            with contextlib.suppress(OSError):
                self.path.rmdir()

    def write(self, clip: Clip) -> None:
        """Write a clip under a free name, then delete the oldest clips beyond the limit and count them.

        Raises:
            BagError: It cannot be written, and nothing of it stays; or an old clip cannot be deleted, and the
                new one stays.
        """
        while not self._write_clip(clip, self._free_name(clip)):
            pass
        try:
            for path in self.clips()[: -self._max_clips]:
                with contextlib.suppress(FileNotFoundError):
                    path.unlink()
                    self.removed += 1
        except OSError as error:
            raise BagError(f'{self.path}: old clips cannot be deleted: {cause(error)}') from error

    def _write_clip(self, clip: Clip, path: Path) -> bool:
        """Write a clip to a new file.

        Returns:
            False if another process has created the file meanwhile: choose another name.

        Raises:
            BagError: The file cannot be written; nothing of it stays.
        """
        columns: dict[str, list[ClipMessage]] = {}
        for message in clip.messages:
            columns.setdefault(message.topic, []).append(message)
        try:
            with BagWriter(path, label=_LABEL) as writer:
                for topic, (first, *_) in columns.items():
                    writer.add_topic(topic, first.type, clip.definitions.get(first.type))
                writer.write_columns(
                    (topic, [m.time_ns for m in messages], [m.data for m in messages])
                    for topic, messages in columns.items()
                )
        except BagError:
            if not path.exists():
                raise
            return False
        return True

    def clips(self) -> list[Path]:
        """Return the paths of the folder's clips, the oldest file first.

        A clip has a name and a label of ours: one that was renamed is not ours to delete.

        Raises:
            OSError: The folder cannot be read.
        """
        paths = []
        for path in self.path.iterdir():
            if _OURS.fullmatch(path.name) and is_labelled(path, _LABEL):
                with contextlib.suppress(FileNotFoundError):
                    paths.append((path.stat().st_mtime_ns, path.name, path))
        return [path for *_, path in sorted(paths)]

    def _free_name(self, clip: Clip) -> Path:
        """Return a free path for a clip, named by time (UTC), bearing and condition, numbered if taken."""
        when = EPOCH + timedelta(seconds=clip.time_ns // 10**9)
        stem = f'{when:%Y%m%dT%H%M%SZ}_{clip.bearing}_{clip.condition.value}'
        names = (f'{stem}{f"-{number}" if number > 1 else ""}.mcap' for number in itertools.count(1))
        return next(self.path / name for name in names if not (self.path / name).exists())

    def _remove_drafts(self) -> None:
        """Remove own or empty drafts to which nothing was written for an hour.

        Newer ones may be another monitor's.

        Raises:
            OSError: The folder cannot be read, or a draft cannot be removed.
        """
        for path in self.path.iterdir():
            if not _DRAFT.fullmatch(path.name) or not path.is_file():
                continue
            state = path.stat()
            is_ours = state.st_size == 0 or is_labelled(path, _LABEL)
            if is_ours and time.time() - state.st_mtime > 3600.0:
                path.unlink(missing_ok=True)


@dataclass(slots=True)
class ClipCounts:
    """Numbers of clips written and lost for a recording."""

    written: int = 0
    removed: int = 0  # older ones that made room
    failures: list[str] = field(default_factory=list)  # why others could not be written


class ClipWriter(StretchSink):
    """Writes a clip of every alarm in a recording, as the node does while it runs.

    A part of the recording waits until no alarm can follow within the length of a clip. A clip that
    cannot be written is listed in ``counts.failures``; the others are written.

    Args:
        store: Where to; also of several recordings one after the other.
    """

    def __init__(self, store: ClipFolder) -> None:
        self._store = store
        self.counts = ClipCounts()

    def begin(self, bag: Recording, config: MonitorConfig, start_ns: int | None) -> None:
        """Reset for a recording: it has no alarms and no waiting parts yet; ``counts`` are kept.

        ``start_ns`` is its start on the clock of the samples [ns], ``None`` if it is empty.

        Raises:
            BagError: The definition of an input cannot be read.
        """
        self._bag, self._topics = bag, input_topics(bag, config)
        definitions = {kind: text for _, kind, text in topics(bag, config) if text is not None}
        self._recorder = ClipRecorder(config.clips, definitions)
        self._messages = VerdictMessages(config, start_ns, pays_to_compile(bag, config))
        self._around_ns = config.clips.around_ns
        self._waiting: deque[tuple[int, Stretch]] = deque()
        self._alarms: list[int] = []
        self._begun_ns = 0

    def take(self, stretch: Stretch) -> None:
        """Keep the next part; write and count the clips of parts that no later alarm can need.

        Raises:
            BagError: The messages of an input cannot be read.
        """
        self._alarms += [e.time_ns for e in events_of(stretch) if begins_clip(e)]
        self._waiting.append((self._begun_ns, stretch))
        self._begun_ns = stretch.end_ns + 1
        while self._waiting[0][1].end_ns + self._around_ns < stretch.end_ns:
            self._pass_messages(*self._waiting.popleft())

    def finish(self) -> None:
        """Write and count the clips of the parts that still waited, and of alarms near the end.

        Raises:
            BagError: The messages of an input cannot be read.
        """
        while self._waiting:
            self._pass_messages(*self._waiting.popleft())
        self._recorder.finish()
        self._write_due()

    def _pass_messages(self, begun_ns: int, stretch: Stretch) -> None:
        """Read and pass a part's messages around alarms to the recorder, in order of time.

        Writes and counts the clips that are complete with them. The verdicts are followed over the part.

        Args:
            begun_ns: The first log time of the part [ns].
            stretch: The part.

        Raises:
            BagError: The messages of an input cannot be read.
        """
        around = self._around_ns
        spans = TimeSpans((t - around, t + around) for t in self._alarms)
        following = (e for e in events_of(stretch) if spans.overlap(e.time_ns, e.time_ns))
        spans_here = TimeSpans(
            (max(a, begun_ns), min(b, stretch.end_ns))
            for a, b in spans.spans
            if a <= stretch.end_ns and b >= begun_ns
        )
        inputs = self._bag.messages(self._topics, spans_here) if spans_here.spans else iter(())
        columns = [*columns_of(inputs), *self._messages.encode_stretch(stretch, spans)]
        for message in _sort_messages(columns):
            self._recorder.add(message)
            if message.topic == f'/{NODE}/warnings':
                self._recorder.note(next(following))
            self._write_due()

    def _write_due(self) -> None:
        """Write the clips that are complete, and update ``counts``: written, failed and removed ones."""
        for clip in self._recorder.pop_clips():
            try:
                self._store.write(clip)
                self.counts.written += 1
            except BagError as error:
                self.counts.failures.append(str(error))
        self.counts.removed = self._store.removed


def _sort_messages(columns: Sequence[MessageColumn]) -> list[ClipMessage]:
    """Return the messages of all topics in order of time; those of one time in the order of the columns."""
    ordered = []
    for topic, kind, time_ns, payload in columns:
        messages = (
            payload.view(f'V{payload.itemsize}').tolist() if isinstance(payload, np.ndarray) else payload
        )
        ordered += [ClipMessage(t, topic, kind, d) for t, d in zip(time_ns.tolist(), messages, strict=True)]
    return sorted(ordered, key=lambda message: message.time_ns)
