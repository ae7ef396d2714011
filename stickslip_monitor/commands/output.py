# SPDX-License-Identifier: Apache-2.0
"""Output that commands share: tables, JSON without infinities, files, and progress."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from stickslip_monitor.errors import ReportError

# Shorter work shows no bar, and does not import one [s].
_PATIENCE = 0.5


class ProgressBar:
    """A progress bar on the standard error, where that is a terminal; a context manager."""

    def __init__(self) -> None:
        self._begin = time.monotonic()
        self._bar: Any = None
        self._wanted = sys.stderr.isatty()

    def __enter__(self) -> ProgressBar:
        """Begin."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Take the bar away."""
        self.hide()

    def show(self, text: str, done: float, total: float | None) -> None:
        """Show how far the work is."""
        if not self._wanted or time.monotonic() - self._begin < _PATIENCE:
            return
        if self._bar is None:
            self._bar = _new_bar()
            self._task = self._bar.add_task('', total=None)
            self._bar.start()
        from rich.markup import escape

        self._bar.update(self._task, description=escape(text), completed=done, total=total)

    def hide(self) -> None:
        """Take the bar away, so that something else can be written."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None


def _new_bar() -> Any:
    from rich.console import Console
    from rich.progress import Progress

    # Otherwise the bar would redirect printed text to the standard error.
    return Progress(
        console=Console(stderr=True),
        transient=True,
        redirect_stdout=False,
        redirect_stderr=False,
    )


if TYPE_CHECKING:
    from rich.console import Console


def add_config(parser: argparse.ArgumentParser, required: bool = True) -> None:
    """Add ``--config``."""
    parser.add_argument(
        '--config', '-c', required=required, metavar='FILE', help='ROS 2 parameter file'
    )


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add ``--json``."""
    parser.add_argument('--json', action='store_true', help='print JSON, SI units, null for none')


def json_text(document: Any) -> str:
    """One JSON document as text that ends its last line."""
    return json.dumps(document, indent=2, allow_nan=False) + '\n'


def print_json(document: Any) -> None:
    """Print one JSON document."""
    sys.stdout.write(json_text(document))


def write_whole(path: Path, data: bytes) -> None:
    """Write a file under its name only when all of it is written; one that is there is replaced.

    Raises:
        ReportError: It cannot be written; what was there stays.
    """
    draft = None
    try:
        number, draft = tempfile.mkstemp(prefix=f'.{path.name}.', dir=path.parent)
        with os.fdopen(number, 'wb') as file:
            file.write(data)
        # mkstemp makes a private file; a report has the usual permissions.
        mask = os.umask(0)
        os.umask(mask)
        Path(draft).chmod(0o666 & ~mask)
        Path(draft).replace(path)
    except OSError as error:
        raise ReportError(f"'{path}' cannot be written: {error.strerror or error}") from error
    finally:
        if draft is not None:
            with contextlib.suppress(OSError):
                Path(draft).unlink(missing_ok=True)


def console() -> Console:
    """The console for tables; plain text where the output is not a terminal."""
    from rich.console import Console  # costs time to import, and not every command prints with it

    return Console(highlight=False, soft_wrap=not sys.stdout.isatty())
