# SPDX-License-Identifier: Apache-2.0
"""Checks and writes the outputs of commands: files, tables, JSON and progress.

Before a command runs, :func:`check_files` refuses every output that would destroy something: one
that is an input by any name, also a file that only the configuration names, one that is another
output, and one that this package did not write. :func:`write_outputs` writes them.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import shutil
import sys
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_monitor.commands.options import FileOption, Marks
from stickslip_monitor.errors import OutputError, StickslipError, cause
from stickslip_monitor.safe_files import check_replaceable, holds_mark, is_same, printable, write_whole

if TYPE_CHECKING:
    from rich.console import Console, Group
    from rich.table import Table
    from rich.text import Text

# Shorter work shows no bar, and does not import one [s].
_PATIENCE = 0.5
# How rich ends what it has cut off.
_CUT = '\N{HORIZONTAL ELLIPSIS}'
_YAML = ('.yaml', '.yml')


def output_ending(path: str | Path, marks: Marks) -> str:
    """Return the ending of an output's path, as ``.csv``, in lower case; '' for any other where allowed.

    Raises:
        OutputError: No format has this ending.
    """
    suffix = Path(path).suffix.lower()
    if suffix in marks or '' in marks:
        return suffix if suffix in marks else ''
    rule = f'one of {", ".join(marks)}: the ending chooses the format' if len(marks) > 1 else ''.join(marks)
    raise OutputError(f"output '{path}' must end in {rule}")


def check_files(args: argparse.Namespace) -> None:
    """Refuse outputs that would destroy something, before any work is done.

    Raises:
        OutputError: A file has an empty name; or an output has a wrong ending, is an input by any name or
            another output, would lie in a folder that is read or cannot be written, or exists and is not ours
            (allowed by ``--force``).
    """
    files, written = getattr(args, 'files', ()), list[str]()
    inputs = [path for option in files if option.is_read for path in option.paths(args)]
    for option in files:
        for path in () if option.is_read else option.paths(args):
            if option.marks is None:
                _check_recording(path, option, inputs)
                continue
            _check_output(path, option, inputs, force=args.force)
            for earlier in written:
                if is_same(path, earlier):
                    raise OutputError(f"outputs '{earlier}' and '{path}' are one file: choose two")
            written.append(path)


def _check_recording(path: str, option: FileOption, inputs: Sequence[str]) -> None:
    """Check that a recording to write does not lie in a folder that is read.

    Raises:
        OutputError: It does.
    """
    folder = Path(path) if option.is_folder else Path(path).parent
    for read in inputs:
        if Path(read).is_dir() and is_same(folder, read):
            raise OutputError(
                f"{option.spelling} would write into the folder '{read}', whose recordings are"
                ' checked: choose another folder'
            )


def _check_output(path: str, option: FileOption, inputs: Sequence[str], *, force: bool) -> None:
    """Raise OutputError if an output is an input, has a wrong ending, or would replace a foreign file.

    An option that renews may replace an input of the same kind; ``force`` allows to replace a foreign file.
    """
    marks = option.marks or {}
    mark = marks[output_ending(path, marks)]
    if Path(path).exists() and not (option.renews and mark and holds_mark(path, mark)):
        for file in itertools.chain.from_iterable(map(_find_input_paths, inputs)):
            if is_same(path, file):
                raise OutputError(f"output '{path}' is the input '{file}': choose another name")
    check_replaceable(path, mark, force=force)


def _find_input_paths(path: str) -> Iterator[Path]:
    """Yield the path of an input, and of the files in a folder; of YAML also each text as a path.

    Such a path need not exist; it is yielded from the file's folder and from the current one. YAML that
    cannot be read yields no texts.
    """
    yield Path(path)
    if Path(path).is_dir():
        for folder, _, names in os.walk(path):
            yield from (Path(folder) / name for name in names)
    elif Path(path).suffix.lower() in _YAML:
        from stickslip_monitor.monitor.parameter_file import load_yaml

        try:
            named = list(_find_texts(load_yaml(path)))
        except StickslipError:
            return  # the command itself says what is wrong with it
        for name in named:
            yield Path(path).parent / name
            yield Path(name)


def _find_texts(document: Any) -> Iterator[str]:
    """Yield all texts in a document of mappings and lists, at any depth, that could be names of files."""
    if isinstance(document, Mapping | list):
        for value in document.values() if isinstance(document, Mapping) else document:
            yield from _find_texts(value)
    elif isinstance(document, str) and document and '\0' not in document:
        yield document


def write_outputs(args: argparse.Namespace, **makers: Callable[[], Any]) -> None:
    """Write the outputs that are asked for, and report each on the error stream.

    Args:
        args: The arguments.
        makers: By the destination of its option, a function that makes the contents of an output: the
            columns of a table, a figure, a text, or bytes.

    Raises:
        DrawingError, OutputError: One cannot be written.
        Exception: An error of a maker passes through.
    """
    for dest, make in makers.items():
        path = getattr(args, dest)
        if path is not None:
            (marks,) = (option.marks for option in args.files if option.dest == dest)
            _write_file(path, make(), marks or {}, force=args.force)
            report_written(path)


def _write_file(path: str, contents: Any, marks: Marks, *, force: bool) -> None:
    """Write a text, bytes, columns (CSV) or a figure to a file.

    Args:
        path: The file.
        contents: The text, bytes, columns by heading, or figure.
        marks: What a file of ours contains, by its ending; see :data:`.options.Marks`.
        force: Whether to replace a file that is not ours.

    Raises:
        OutputError: The file cannot be written.
        DrawingError: A figure cannot be written.
    """
    data = contents.encode() if isinstance(contents, str) else contents
    if isinstance(data, bytes):
        try:
            write_whole(path, data, marks[output_ending(path, marks)] or b'', force=force)
        except OSError as error:
            raise OutputError(f"'{path}' cannot be written: {cause(error)}") from error
        return
    from stickslip_monitor.drawing.canvas import save_figure, write_csv

    write = write_csv if isinstance(contents, Mapping) else save_figure
    write(contents, path, force)


def report_written(path: str | Path) -> None:
    """Report on the error stream that a file is written."""
    sys.stderr.write(f'{printable(str(path))} written\n')


class ProgressBar:
    """Progress bar on standard error, if that is a terminal; a context manager that hides it at the end."""

    def __init__(self) -> None:
        self._begin = time.monotonic()
        self._bar: Any = None
        self._wanted = sys.stderr.isatty()

    def __enter__(self) -> ProgressBar:
        """Return the bar itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Remove the bar."""
        self.hide()

    def show(self, text: str, done: float, total: float | None) -> None:
        """Show how far the work is: ``done`` of ``total`` in any unit, None if the total is unknown.

        Does nothing in the first half second, or if standard error is no terminal.
        """
        if not self._wanted or time.monotonic() - self._begin < _PATIENCE:
            return
        from rich.console import Console
        from rich.markup import escape
        from rich.progress import Progress

        if self._bar is None:
            # Otherwise the bar would redirect printed text to the standard error.
            self._bar = Progress(
                console=Console(stderr=True), transient=True, redirect_stdout=False, redirect_stderr=False
            )
            self._task = self._bar.add_task('', total=None)
            self._bar.start()

        self._bar.update(self._task, description=escape(printable(text)), completed=done, total=total)

    def hide(self) -> None:
        """Remove the bar, so that something else can be printed; the next :meth:`show` draws it again."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None


def json_text(document: Any) -> str:
    """Return a JSON document as text with a final newline.

    Raises:
        ValueError: A number in it is not finite.
    """
    return json.dumps(document, indent=2, allow_nan=False) + '\n'


def print_json(document: Any) -> None:
    """Print one JSON document; raise ValueError where a number in it is not finite."""
    sys.stdout.write(json_text(document))


def line_width() -> int | None:
    """Return the letters on a line of the terminal; ``None`` where the output is not a terminal."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else None


def console() -> Console:
    """Return a new console for tables: plain and unwrapped where the output is not a terminal.

    It prints a table that is too wide as a list, and makes control characters in texts harmless.
    """
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
            super().print(*(self._fit_table(item) for item in objects), **options)

        def _fit_table(self, item: Any) -> Any:
            """Return a table that does not fit as a list, and anything else as it is."""
            if not isinstance(item, Table):
                return item
            drawn = (part.text for line in self.render_lines(item) for part in line)
            return _as_list(item) if any(_CUT in text for text in drawn) else item

    return SafeConsole(highlight=False, soft_wrap=line_width() is None)


def make_table(title: str, headings: str, left: Collection[int] = (0,), caption: str | None = None) -> Table:
    """Return a table without rows.

    Args:
        title: Its title; '' for none.
        headings: Of its columns, parted by ``'; '``.
        left: Which columns, from 0, are aligned left; the others are aligned right.
        caption: A text below it; ``None`` for none.
    """
    from rich.table import Table

    table = Table(title=title or None, title_justify='left', caption=caption)
    for k, heading in enumerate(headings.split('; ')):
        table.add_column(heading, justify='left' if k in left else 'right')
    return table


def _as_list(table: Table) -> Group:
    """Return a table as a list for a narrow screen: a block a row, a line for each cell that is not empty."""
    from rich.console import Group

    headings = [str(column.header).replace('-\n', '').replace('\n', ' ') for column in table.columns]
    lines = []
    for first, *rest in zip(*(column.cells for column in table.columns), strict=True):
        lines.append(f'[bold]{first}[/]')
        cells = zip(headings[1:], rest, strict=True)
        lines += [f'  {heading}: {cell}' for heading, cell in cells if cell]
    return Group(*(text for text in (table.title, *lines, table.caption) if text))
