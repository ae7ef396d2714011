# SPDX-License-Identifier: Apache-2.0
"""What a command reads and writes, and its numbers: declared with its options and checked here.

An option that names a file is added by one of the functions here. Before the command runs,
:func:`check_files` refuses every output that would destroy something: one that is an input by any
name, also a file that only the configuration names, one that is another output, and one that this
package did not write. Nothing has been worked out by then. :func:`write_outputs` writes them.
"""

from __future__ import annotations

import argparse
import itertools
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from stickslip_monitor.errors import ConfigurationError, OutputError, StickslipError, cause
from stickslip_monitor.files import (
    PICTURES,
    check_replaceable,
    holds_mark,
    is_same,
    printable,
    write_whole,
)

Marks = Mapping[str, bytes | None]
"""By its ending, what the beginning of a file of ours contains; None where only the contents can
tell, as of a table by its headings. The ending '' stands for any other."""

TABLE: Marks = {'.csv': None}
_YAML = ('.yaml', '.yml')

_Options = argparse._ActionsContainer  # a parser or a group of its options


@dataclass(slots=True)
class FileOptions:
    """What a command's options name, by their destinations.

    ``writes`` has the marks of outputs; ``renews`` are those that may take the place of an input
    of the same kind; ``records`` are recordings, or folders of such, never within what is read;
    ``spellings`` are what a user knows each by.
    """

    reads: list[str] = field(default_factory=list)
    writes: dict[str, Marks] = field(default_factory=dict)
    renews: set[str] = field(default_factory=set)
    records: dict[str, bool] = field(default_factory=dict)
    spellings: dict[str, str] = field(default_factory=dict)

    def spelled(self, action: argparse.Action) -> str:
        """The destination of an option, whose spelling is noted for what is said of it."""
        self.spellings[action.dest] = (*action.option_strings, action.dest)[0]
        return action.dest


def _files(options: _Options) -> FileOptions:
    files = options.get_default('files')
    if files is None:
        files = FileOptions()
        options.set_defaults(files=files)
    assert isinstance(files, FileOptions)
    return files


def add_input(options: _Options, *names: str, **more: Any) -> None:
    """Add an argument that names what is read; its keywords are argparse's."""
    files = _files(options)
    files.reads.append(files.spelled(options.add_argument(*names, **more)))


def add_output(
    options: _Options, *names: str, marks: Marks, renews: bool = False, was: str = '', **more: Any
) -> None:
    """Add an option that names a file to write.

    Args:
        options: The parser.
        names: The option's spellings.
        marks: The endings that can be written.
        renews: Whether it may take the place of an input of the same kind.
        was: Its spelling in the last version, which is understood for one version.
        more: Argparse's keywords.
    """
    action = options.add_argument(*names, **{'metavar': 'FILE'} | more)
    files = _files(options)
    files.writes[files.spelled(action)] = marks
    if renews:
        files.renews.add(action.dest)
    if was:
        options.add_argument(was, dest=action.dest, action=_Renamed, help=argparse.SUPPRESS)


def add_recording(options: _Options, name: str, *, is_folder: bool, **more: Any) -> None:
    """Add an option that names a recording to write, or a folder for such."""
    files = _files(options)
    files.records[files.spelled(options.add_argument(name, **more))] = is_folder


def add_picture(options: _Options, text: str) -> None:
    """Add ``--picture``."""
    add_output(options, '--picture', marks=PICTURES, help=f'.png or .svg: {text}')


def add_config(options: _Options, required: bool = True, text: str = '') -> None:
    """Add ``--config``."""
    text = text or 'ROS 2 parameter file'
    add_input(options, '--config', '-c', required=required, metavar='FILE', help=text)


def add_bearing(options: _Options, text: str = 'only this bearing') -> None:
    """Add ``--bearing``."""
    options.add_argument('--bearing', metavar='NAME', help=text)


def add_number(
    options: _Options, name: str, low: float, high: float = math.inf, *, above: bool = False,
    kind: type[float] = int, **more: Any,
) -> None:  # fmt: skip
    """Add an option that takes a number from ``low``, or above it, to ``high``.

    Its keywords are argparse's.
    """
    options.add_argument(name, action=_Number, rule=(low, high, above), type=kind, **more)


class _Number(argparse.Action):
    """Refuses a number out of bounds, in the sentence that holds for all of them."""

    def __init__(self, *, rule: tuple[float, float, bool], **more: Any) -> None:
        super().__init__(**more)
        self.rule = rule

    def __call__(
        self, parser: argparse.ArgumentParser, args: Any, value: Any, name: str | None = None
    ) -> None:
        low, high, above = self.rule
        if not (low < value < math.inf if above else low <= value) or value > high:
            if high == math.inf:
                rule = f'a number above {low}' if above else f'at least {low}'
            else:
                rule = f'above {low} and at most {high}' if above else f'from {low} to {high}'
            raise ConfigurationError(
                f'{self.option_strings[0]} {str(value).removesuffix(".0")} must be {rule}'
            )
        setattr(args, self.dest, value)


def add_diagnostics(options: _Options) -> None:
    """Add ``--diagnostics``: the topic on which nodes tell their state."""
    text = '(default /diagnostics)'
    options.add_argument('--diagnostics', default='/diagnostics', metavar='TOPIC', help=text)


def add_force(options: _Options) -> None:
    """Add ``--force``."""
    text = 'replace files that stickslip did not write'
    options.add_argument('--force', action='store_true', help=text)


class _Renamed(argparse.Action):
    """An option under the name that it had in the last version."""

    def __call__(
        self, parser: argparse.ArgumentParser, args: Any, value: Any, name: str | None = None
    ) -> None:
        setattr(args, self.dest, value)
        _say_old(f'{name}', f'--{self.dest}')


def _say_old(old: str, new: str) -> None:
    sys.stderr.write(f'{old} is called {new} now; the next version knows only that\n')


def ending(path: str | Path, marks: Marks) -> str:
    """The ending of an output's path, in lower case, or '' for any other where that is allowed.

    Raises:
        OutputError: It is none of those that can be written.
    """
    suffix = Path(path).suffix.lower()
    if suffix in marks or '' in marks:
        return suffix if suffix in marks else ''
    raise OutputError(
        f"output '{path}' must end in one of {', '.join(marks)}: the ending chooses the format"
    )


def check_files(args: argparse.Namespace) -> None:
    """Refuse outputs that would destroy something, before any work is done.

    Raises:
        OutputError: An output has an ending that cannot be written, is an input by any name, or
            another output, or is there already and not ours.
    """
    files = getattr(args, 'files', None) or FileOptions()
    # A picture was asked for by -o in the last version, where that is now a table.
    path = getattr(args, 'output', None)
    if 'picture' in files.writes and path and Path(path).suffix.lower() in PICTURES:
        _say_old('-o for a picture', '--picture')
        args.output, args.picture = None, args.picture or path
    inputs = [path for dest in files.reads for path in _paths(args, dest)]
    written: list[str] = []
    for dest, marks in files.writes.items():
        for path in _paths(args, dest):
            _check_output(path, marks, inputs, args.force, dest in files.renews)
            for other in written:
                if is_same(path, other):
                    raise OutputError(f"outputs '{other}' and '{path}' are one file: choose two")
            written.append(path)
    for dest, is_folder in files.records.items():
        for path in _paths(args, dest):
            folder = Path(path) if is_folder else Path(path).parent
            for read in inputs:
                if Path(read).is_dir() and is_same(folder, read):
                    raise OutputError(
                        f"--{dest} would write into the folder '{read}', whose recordings are"
                        ' checked: choose another folder'
                    )


def check_output(path: str | Path, marks: Marks, args: argparse.Namespace) -> None:
    """The same for a file in a folder that an option names.

    Raises:
        OutputError: It is an input, or is there already and not ours.
    """
    inputs = [path for dest in args.files.reads for path in _paths(args, dest)]
    _check_output(str(path), marks, inputs, args.force)


def _check_output(
    path: str, marks: Marks, inputs: Sequence[str], force: bool, renews: bool = False
) -> None:
    mark = marks[ending(path, marks)]
    if Path(path).exists() and not (renews and mark and holds_mark(path, mark)):
        for file in itertools.chain.from_iterable(map(_read_with, inputs)):
            if is_same(path, file):
                raise OutputError(f"output '{path}' is the input '{file}': choose another name")
    check_replaceable(path, mark, force)


def _paths(args: argparse.Namespace, dest: str) -> Sequence[str]:
    """The paths that an option was given; none if it was not."""
    value = getattr(args, dest)
    if value is None:
        return ()
    paths = [value] if isinstance(value, str) else list(value)
    if '' in paths:
        raise OutputError(f'{args.files.spellings[dest]} is given an empty name')
    return paths


def _read_with(path: str) -> Iterator[Path]:
    """The files that come with an input: itself, those in a folder, those that its text names."""
    yield Path(path)
    if Path(path).is_dir():
        for folder, _, names in os.walk(path):
            yield from (Path(folder) / name for name in names)
    elif Path(path).suffix.lower() in _YAML:
        from stickslip_monitor.monitor.config_file import load_yaml

        try:
            named = list(_texts(load_yaml(path)))
        except StickslipError:
            return  # the command itself says what is wrong with it
        for name in named:
            yield Path(path).parent / name
            yield Path(name)


def _texts(document: Any) -> Iterator[str]:
    """All texts in a document that could be names of files."""
    if isinstance(document, Mapping | list):
        for value in document.values() if isinstance(document, Mapping) else document:
            yield from _texts(value)
    elif isinstance(document, str) and document and '\0' not in document:
        yield document


def write_outputs(args: argparse.Namespace, **makers: Callable[[], Any]) -> None:
    """Write those outputs that are asked for, and say on the error stream which.

    Args:
        args: The arguments.
        makers: By the destination of its option, what makes the contents of an output: the
            columns of a table, a figure, a text, or bytes.

    Raises:
        DrawingError, OutputError: One cannot be written.
    """
    for dest, make in makers.items():
        path = getattr(args, dest)
        if path is not None:
            _write(path, make(), args.files.writes[dest], args.force)
            say_written(path)


def _write(path: str, contents: Any, marks: Marks, force: bool) -> None:
    data = contents.encode() if isinstance(contents, str) else contents
    if isinstance(data, bytes):
        try:
            write_whole(path, data, marks[ending(path, marks)] or b'', force)
        except OSError as error:
            raise OutputError(f"'{path}' cannot be written: {cause(error)}") from error
        return
    from stickslip_monitor.drawing.canvas import save_figure, write_csv

    write = write_csv if isinstance(contents, Mapping) else save_figure
    write(contents, path, force)


def say_written(path: str | Path) -> None:
    """Say on the error stream that a file is written."""
    sys.stderr.write(f'{printable(str(path))} written\n')
