# SPDX-License-Identifier: Apache-2.0
"""Output that commands share: tables, JSON without infinities, and progress."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import time
from typing import TYPE_CHECKING, Any

from stickslip_monitor.files import printable

# Shorter work shows no bar, and does not import one [s].
_PATIENCE = 0.5
# How rich ends what it has cut off.
_CUT = '\N{HORIZONTAL ELLIPSIS}'


class ProgressBar:
    """A progress bar on the standard error, where that is a terminal; a context manager."""

    def __init__(self) -> None:
        self._begin = time.monotonic()
        self._bar: Any = None
        self._wanted = sys.stderr.isatty()

    def __enter__(self) -> ProgressBar:
        """Begin."""
        return self

    def __exit__(self, *_: object) -> None:
        """Take the bar away."""
        self.hide()

    def show(self, text: str, done: float, total: float | None) -> None:
        """Show how far the work is."""
        if not self._wanted or time.monotonic() - self._begin < _PATIENCE:
            return
        from rich.console import Console
        from rich.markup import escape
        from rich.progress import Progress

        if self._bar is None:
            # Otherwise the bar would redirect printed text to the standard error.
            self._bar = Progress(
                console=Console(stderr=True), transient=True, redirect_stdout=False,
                redirect_stderr=False,
            )  # fmt: skip
            self._task = self._bar.add_task('', total=None)
            self._bar.start()

        self._bar.update(
            self._task, description=escape(printable(text)), completed=done, total=total
        )

    def hide(self) -> None:
        """Take the bar away, so that something else can be written."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None


if TYPE_CHECKING:
    from rich.console import Console, Group
    from rich.table import Table
    from rich.text import Text


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add ``--json``."""
    parser.add_argument('--json', action='store_true', help='print JSON, SI units, null for none')


def json_text(document: Any) -> str:
    """One JSON document as text that ends its last line."""
    return json.dumps(document, indent=2, allow_nan=False) + '\n'


def print_json(document: Any) -> None:
    """Print one JSON document."""
    sys.stdout.write(json_text(document))


def line_width() -> int | None:
    """Letters on a line of the terminal; None where the output goes elsewhere, unbroken."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else None


def console() -> Console:
    """The console for tables; plain text where the output is not a terminal."""
    from rich.console import Console  # costs time to import, and not every command prints with it
    from rich.table import Table

    class SafeConsole(Console):
        """Prints no escapes of others: names that it is given may come from a file.

        A table that does not fit is printed as a list, a line for each cell.
        """

        def render_str(self, text: str, *arguments: Any, **options: Any) -> Text:
            safe = '\n'.join(map(printable, text.split('\n')))
            return super().render_str(safe, *arguments, **options)

        def print(self, *objects: Any, **options: Any) -> None:
            super().print(*(self._fitted(item) for item in objects), **options)

        def _fitted(self, item: Any) -> Any:
            if not isinstance(item, Table):
                return item
            drawn = (part.text for line in self.render_lines(item) for part in line)
            return _as_list(item) if any(_CUT in text for text in drawn) else item

    return SafeConsole(highlight=False, soft_wrap=line_width() is None)


def _as_list(table: Table) -> Group:
    """The same for a narrow screen: a block for each row, a line for each of its cells."""
    from rich.console import Group

    headings = [
        str(column.header).replace('-\n', '').replace('\n', ' ') for column in table.columns
    ]
    lines = []
    for first, *others in zip(*(column.cells for column in table.columns), strict=True):
        lines.append(f'[bold]{first}[/]')
        cells = zip(headings[1:], others, strict=True)
        lines += [f'  {heading}: {cell}' for heading, cell in cells if cell]
    return Group(*(text for text in (table.title, *lines, table.caption) if text))
