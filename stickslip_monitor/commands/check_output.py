# SPDX-License-Identifier: Apache-2.0
"""What `stickslip check` prints and writes, one bag after the other."""

from __future__ import annotations

import os
import sys
from datetime import datetime, timezone
from typing import TYPE_CHECKING, Any

from stickslip_monitor.commands.check_task import Found
from stickslip_monitor.commands.check_text import to_text
from stickslip_monitor.commands.output import print_json

if TYPE_CHECKING:
    from stickslip_monitor.commands.report import ReportFile


class Output:
    """Takes the bags in the order in which they are asked for.

    Args:
        as_json: Whether JSON is printed, at the end, instead of text.
        file: The report, if any.
        listed: Whether JSON is a list, for several bags.
        clips: Where clips go, if any.

    Attributes:
        code: The exit code so far: 1 after a warning, 2 after a bag that could not be checked.
    """

    def __init__(
        self, as_json: bool, file: ReportFile | None, listed: bool, clips: str | None
    ) -> None:
        self._as_json, self._file, self._listed, self._clips = as_json, file, listed, clips
        self._coloured = sys.stdout.isatty() and 'NO_COLOR' not in os.environ
        self._documents: list[dict[str, Any]] = []
        self.code = 0

    def take(self, found: Found) -> None:
        """Take up one bag."""
        document = found.document
        self.code = max(self.code, 2 if found.error else int(found.warned))
        if self._as_json:
            self._documents.append(document)
        elif not found.error:
            sys.stdout.write(to_text(document, self._coloured))
            sys.stdout.flush()
        if found.error:
            sys.stderr.write(f'ERROR: {document["path"]}: {found.error}\n')
        if found.clips is not None:
            sys.stderr.write(
                f'{document["path"]}: {found.clips} clips written into {self._clips}\n'
            )
        if self._file is not None:
            self._file.add(found.part, document)

    def finish(self) -> None:
        """Print and write what only makes a whole with the last bag."""
        if self._file is not None:
            self._file.write(datetime.now(timezone.utc), self._listed)
        if self._as_json:
            print_json(self._documents if self._listed else self._documents[0])
