# SPDX-License-Identifier: Apache-2.0
"""Output that commands share: tables, JSON without infinities, files, and progress."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from stickslip_monitor.errors import OutputError
from stickslip_monitor.files import check_replaceable, is_same, printable

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

        self._bar.update(
            self._task, description=escape(printable(text)), completed=done, total=total
        )

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
    from rich.console import Console, Group
    from rich.table import Table
    from rich.text import Text


def add_config(parser: argparse.ArgumentParser, required: bool = True) -> None:
    """Add ``--config``."""
    parser.add_argument(
        '--config', '-c', required=required, metavar='FILE', help='ROS 2 parameter file'
    )


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add ``--json``."""
    parser.add_argument('--json', action='store_true', help='print JSON, SI units, null for none')


def add_force(parser: argparse.ArgumentParser) -> None:
    """Add ``--force``."""
    parser.add_argument(
        '--force', action='store_true', help='replace files that stickslip did not write'
    )


def json_text(document: Any) -> str:
    """One JSON document as text that ends its last line."""
    return json.dumps(document, indent=2, allow_nan=False) + '\n'


def print_json(document: Any) -> None:
    """Print one JSON document."""
    sys.stdout.write(json_text(document))


def check_outputs(
    outputs: Iterable[tuple[str | Path | None, bytes | None]],
    inputs: Iterable[str | Path | None],
    force: bool,
) -> None:
    """Refuse outputs that would destroy something, before any work is done.

    Args:
        outputs: The files to write, None for none, each with what the beginning of one of ours
            contains; None where only the contents can tell.
        inputs: What is read: files, and folders of recordings; None for none.
        force: Whether files of others are replaced; an input never is.

    Raises:
        OutputError: An output is an input by any name, or another output, or is there already
            and not ours.
    """
    read = [file for path in inputs if path for file in _files_of(Path(path))]
    written: list[str | Path] = []
    for output, mark in outputs:
        if output is None:
            continue
        for file in read:
            if is_same(output, file):
                raise OutputError(f"output '{output}' is the input '{file}': choose another name")
        for other in written:
            if is_same(output, other):
                raise OutputError(f"outputs '{other}' and '{output}' are one file: choose two")
        check_replaceable(output, mark, force)
        written.append(output)


def _files_of(path: Path) -> list[Path]:
    """What an input consists of: itself, and the files in it if it is a folder."""
    try:
        return [path, *path.iterdir()] if path.is_dir() else [path]
    except OSError:
        return [path]


def say_written(*paths: str | Path | None) -> None:
    """Say on the error stream which files were written; None is none."""
    for path in paths:
        if path is not None:
            sys.stderr.write(f'{printable(str(path))} written\n')


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
