# SPDX-License-Identifier: Apache-2.0
"""Presents a table of numbers with times as a recording.

A column stands for the topic of an input: what the sensor would have sent is computed from the
unit of the column.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator

import numpy as np

from stickslip_logs.errors import BagError
from stickslip_logs.recordings.recording import Message, Progress, Request, TimeSpans, missing_topic
from stickslip_logs.recordings.table_columns import FLOAT64, ColumnRecording, SourceColumn
from stickslip_logs.recordings.table_reading import TableReading
from stickslip_logs.recordings.writer import encode_float64s


class TableRecording(ColumnRecording):
    """A table as the recording that it stands for."""

    def definition(self, topic: str) -> str:
        """Return the definition of a ``Float64``, which the sensors would have sent.

        Raises:
            BagError: No delivered topic, and no column, has this name.
        """
        self._find_column(topic)
        return 'float64 data\n'

    def _find_column(self, topic: str) -> SourceColumn:
        """Return the source of a delivered topic, or else that of the column with this heading.

        Raises:
            BagError: There is neither.
        """
        if topic in self.by_topic:
            return self.by_topic[topic]
        for column in self.all_columns:
            if column.heading == topic:
                return SourceColumn(column)
        raise BagError(missing_topic(self.topics, topic))

    def reading(self, requests: Iterable[Request], progress: Progress | None = None) -> TableReading:
        """Return a pass over the table; read the file at once to buffer numbers and judge their order.

        That adds warnings and losses, and may correct start and end. The fields of requests are ignored.

        Raises:
            BagError: A topic is not there, or as of :class:`.TableReading`.
            OSError: The file is no longer there.
        """
        wanted = list(requests)
        columns = {request.topic: self._find_column(request.topic) for request in wanted}
        # Those of one line count from left to right, in whatever order they are asked for.
        columns = dict(
            sorted(columns.items(), key=lambda item: (item[1].column.place, item[1].column.heading))
        )
        return TableReading(self, wanted, columns, progress)

    def messages(
        self, topics: Collection[str] | None = None, spans: TimeSpans | None = None
    ) -> Iterator[Message]:
        """Yield as :meth:`.Recording.messages` what the sensors would have sent, by time, then by column.

        All delivered topics are meant where ``topics`` is None; errors are raised as the first is asked for.
        A word in place of a number is sent as NaN.
        """
        names = list(self.by_topic if topics is None else topics)
        for part in self.reading([Request(name, 'data') for name in names]):
            rows: list[tuple[int, str, int, bytes]] = []
            for request, series in part.items():
                keep = np.full(series.value.size, True)
                if spans is not None:
                    keep = spans.holds(series.log_time_ns)
                data = encode_float64s(series.value[keep])
                numbers, times = series.sequence[keep].tolist(), series.log_time_ns[keep].tolist()
                topic = [request.topic] * len(data)
                rows += zip(numbers, topic, times, data, strict=True)
            yield from (Message(name, FLOAT64, time, data) for _, name, time, data in sorted(rows))
