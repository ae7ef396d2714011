# SPDX-License-Identifier: Apache-2.0
# PYTHON_ARGCOMPLETE_OK
"""The command line ``stickslip``: one thin door to the commands.

Exit codes: 0 all is fine, 1 warnings were found, 2 bad input, 3 a fault of the program.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import io
import os
import re
import sys
import traceback
import warnings
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NoReturn

from stickslip_monitor import __version__, interruption
from stickslip_monitor.commands.output import check_files
from stickslip_monitor.errors import ConfigurationError, StickslipError, cause, did_you_mean, program_fault
from stickslip_monitor.safe_files import printable, redirect_to_null

COMMANDS = {
    'accuracy': 'show what accuracy costs in time',
    'assess': 'assess one operating point',
    'calibrate': 'infer the boundaries from recordings and reports of vibration',
    'check': 'run the monitor over recorded bags',
    'dashboard': 'serve a page to watch bearings and deal with alarms',
    'diagram': 'draw the bifurcation diagram over speed',
    'fit': 'fit the Stribeck law to a measured friction curve',
    'health': 'ask a running monitor whether it monitors',
    'init': 'write a parameter file from a drawing and a data sheet',
    'info': 'show what a recording holds',
    'map': 'draw the stability map over speed and load',
    'play': 'publish a bag to ROS 2, with /clock',
    'simulate': 'make a bag from a scene file',
    'watch': "watch bearings on the ship's own buses, Signal K and NMEA 0183",
}

PACKAGE = 'stickslip_monitor.commands'
# Where a command is that is in a package of its own; that one need not be installed.
ELSEWHERE = dict.fromkeys(('accuracy', 'calibrate', 'fit', 'simulate'), 'stickslip_lab.commands')
# For one version: where commands went that no user of a ship calls.
_MOVED = {
    'figures': '`python scripts/draw_findings.py`, in the source tree',
    'score': '`python -m benchmarks.score`, in the source tree',
}
# For one version: what stands for options that went.
_HEIRS = {
    '--add': 'give all recordings together',
    '--bench': 'put the errors of a bench into tolerance in the parameter file',
    '--cost': 'see docs/accuracy.md',
    '--csv': 'it is --output',
    '--level': 'configure level.topic in the parameter file',
    '--resume': 'run the check again, which is one pass',
    '--learn': 'use stickslip calibrate, which says what it would change',
}


class _ErrorStream(io.TextIOWrapper):
    """Standard error that ignores what cannot be written, as on a full disk."""

    def write(self, text: str) -> int:
        """Write a text; where that fails, drop it and all that follows. Return its length."""
        try:
            return super().write(text)
        except OSError:
            redirect_to_null(self.fileno())
            return len(text)

    def flush(self) -> None:
        """Flush what was written; where that fails, drop it and all that follows."""
        try:
            super().flush()
        except OSError:
            redirect_to_null(self.fileno())


class _Paragraphs(argparse.HelpFormatter):
    """Fills each paragraph of a description to the width of the terminal."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        """Return a text with each paragraph filled by itself; empty lines divide them."""
        paragraphs = text.split('\n\n')
        return '\n\n'.join(super(_Paragraphs, self)._fill_text(p, width, indent) for p in paragraphs)


class _Parser(argparse.ArgumentParser):
    """Parser that names one wrong option in a sentence, an unknown one before a missing one."""

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse as argparse does, but first refuse an option that is gone or unknown.

        Raises:
            ConfigurationError: For the first such option.
        """
        for argument in self._own_options(args):
            # A value may follow a short option at once.
            long = argument.startswith('--')
            option = argument.partition('=')[0] if long else argument[:2]
            if not any(option_text.startswith(option) for option_text in self._option_string_actions):
                if heir := _HEIRS.get(option):
                    self.error(f"option '{option}' is gone: {heir}")
                hint = did_you_mean(option, self._option_string_actions)
                self.error(f"option '{argument}' is not known{hint}")
        return super().parse_known_args(args, namespace)

    def _own_options(self, args: Sequence[str]) -> Iterator[str]:
        """Yield the arguments that are options of this parser: of the program, those before the command."""
        for argument in args:
            if argument == '--' or (self._subparsers and not argument.startswith('-')):
                return
            if argument.startswith('--') or re.match('-[A-Za-z]', argument):
                yield argument

    def error(self, message: str) -> NoReturn:
        """Raise a ConfigurationError with a message and the way to the help, where argparse would exit."""
        raise ConfigurationError(f'{message} (see {self.prog} --help)')


def _make_parser(
    chosen: str | None, help_texts: Mapping[str, str] = COMMANDS, package: str = PACKAGE
) -> argparse.ArgumentParser:
    """Build the parser; of the commands only the module of the chosen one, if any, is imported.

    Raises:
        ConfigurationError: The package of that command is not installed.
    """
    parser = _Parser(
        prog='stickslip',
        description="Predicts stick-slip of ships' stern bearings from shaft speed and load.",
        epilog='`stickslip help COMMAND` shows the options of a command. Exit codes: 0 fine, 1'
        ' warnings found, 2 bad input, 3 a fault of the program.',
    )
    parser.add_argument('--version', action='version', version=f'stickslip {__version__}')
    _add_traceback(parser, default=False)
    commands = parser.add_subparsers(dest='command', metavar='COMMAND', required=True)
    for name, text in help_texts.items():
        place = module_of(name, package)
        module = _load_command(place) if name == chosen else None
        command = commands.add_parser(
            name, help=text, description=module.__doc__ if module else text, formatter_class=_Paragraphs
        )
        if module is not None:
            module.add_arguments(command)
            _add_traceback(command, default=argparse.SUPPRESS)
            command.set_defaults(run=module.run)
    return parser


def _load_command(place: str) -> Any:
    """Import the module of a command by its full name.

    Raises:
        ConfigurationError: Its package is not installed.
    """
    top = place.partition('.')[0]
    if importlib.util.find_spec(top) is None:
        raise ConfigurationError(f'this command is part of {top}, which is not installed')
    return importlib.import_module(place)


def module_of(command: str, package: str = PACKAGE) -> str:
    """Return the full name of a command's module, which need not be there."""
    return f'{ELSEWHERE.get(command, package) if package == PACKAGE else package}.{command}'


def _add_traceback(parser: argparse.ArgumentParser, *, default: object) -> None:
    """Add the option ``--traceback`` to a parser."""
    parser.add_argument(
        '--traceback',
        action='store_true',
        default=default,
        help='after a fault of the program, show where it happened',
    )


def main(
    argv: Sequence[str] | None = None, commands: Mapping[str, str] = COMMANDS, package: str = PACKAGE
) -> int:
    """Run a command; print an error as one sentence on standard error.

    Standard output and error escape from now on what their encoding lacks.

    Args:
        argv: Arguments without the program's name. ``None`` for those of the process, which then belongs to
            the command: its streams, warnings and signals are set up, and signals are ignored at the end.
        commands: The commands, with a line about each.
        package: Where their modules are.

    Returns:
        The exit code: see the head of this module, and 130 after a signal.

    Raises:
        SystemExit: The help or the version was printed.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    if argv is None:
        _open_streams()
        _hide_warnings()
    _escape_unprintable()
    code = _run_reporting_errors(arguments, commands, package, takes_signals=argv is None)
    if argv is None:
        interruption.ignore_signals()
    return code


def _run_reporting_errors(
    arguments: list[str], commands: Mapping[str, str], package: str, *, takes_signals: bool
) -> int:
    """Run a command and return its exit code; print an error as one sentence and return the code for it.

    A reader of the output that has gone counts as a warning (1), and a signal is not printed (130).
    ``takes_signals`` says whether signals are to raise in this process from now on.

    Raises:
        SystemExit: The help or the version was printed.
    """
    try:
        if takes_signals:
            interruption.raise_on_signals()
        return _run_command(arguments, commands, package)
    except StickslipError as error:
        return _print_failure(str(error), 2)
    except BrokenPipeError:
        # The reader (head, less) has gone. What it has not read may be a warning.
        redirect_to_null(sys.stdout.fileno())
        return 1
    except OSError as error:
        # Of what no layer has a sentence for, such as a path that is too long.
        place = f"'{error.filename}': " if error.filename else ''
        return _print_failure(f'{place}{cause(error)}', 2)
    except MemoryError:
        return _print_failure('there is not enough memory for this', 2)
    except KeyboardInterrupt:
        return interruption.EXIT_CODE
    except Exception as error:
        if '--traceback' in arguments and not interruption.is_stopped():
            traceback.print_exc()
        return _print_failure(program_fault(error), 3)


def _run_command(arguments: list[str], commands: Mapping[str, str], package: str) -> int:
    """Parse the arguments, run their command, and return its exit code.

    ``help COMMAND`` stands for ``COMMAND --help``; a shell that asks for completions is answered instead,
    which ends the process.

    Raises:
        ConfigurationError: No command is given, it is unknown or has moved, or an option is wrong.
        OutputError: An output would destroy something (:func:`.output.check_files`).
        SystemExit: The help or the version was printed.
        Exception: Any error of the command passes through.
    """
    arguments = _join_negative_values(arguments)
    if '_ARGCOMPLETE' in os.environ:
        _complete_line()
    command = _asked_command(arguments)
    if command == 'help':
        arguments.remove('help')
        arguments, command = [*arguments, '--help'], _asked_command(arguments)
    if not arguments:
        raise ConfigurationError(f'a command is missing: one of {", ".join(commands)} (see stickslip --help)')
    if command in _MOVED and command not in commands:
        raise ConfigurationError(f"command '{command}' has moved to {_MOVED[command]}")
    if command is not None and command not in commands:
        hint = did_you_mean(command, commands) or f'; there are: {", ".join(commands)}'
        raise ConfigurationError(f"command '{command}' is not known{hint}")
    args = _make_parser(command, commands, package).parse_args(arguments)
    check_files(args)
    code: int = args.run(args)
    sys.stdout.flush()
    return code


def _asked_command(arguments: Sequence[str]) -> str | None:
    """Return the first argument that is not an option; ``None`` for none."""
    return next((argument for argument in arguments if not argument.startswith('-')), None)


def _complete_line() -> None:
    """Answer a shell that asks for completions of its line, and end the process.

    Raises:
        ConfigurationError: The package of the line's command is not installed.
    """
    import argcomplete

    command = _asked_command(os.environ.get('COMP_LINE', '').split()[1:])
    argcomplete.autocomplete(_make_parser(command if command in COMMANDS else None))


def _join_negative_values(arguments: list[str]) -> list[str]:
    """Join ``--speed -20rpm`` to ``--speed=-20rpm`` in a copy: argparse takes -20rpm for an option."""
    joined: list[str] = []
    for argument in arguments:
        last = joined[-1] if joined else ''
        if re.match(r'-\.?\d', argument) and re.fullmatch(r'--[a-z][a-z-]*', last):
            joined[-1] = f'{last}={argument}'
        else:
            joined.append(argument)
    return joined


def _hide_warnings() -> None:
    """Show no warnings of Python, which are for developers, unless -W or PYTHONWARNINGS asks.

    Set PYTHONWARNINGS, so that processes started from here show none either.
    """
    if not sys.warnoptions:
        warnings.simplefilter('ignore')
        os.environ['PYTHONWARNINGS'] = 'ignore'


def _open_streams() -> None:
    """Open closed standard streams on the null device; have standard error ignore what cannot be written.

    A file opened later would take the place of a closed stream.
    """
    for number, name in enumerate(('stdin', 'stdout', 'stderr')):
        if getattr(sys, name) is None:
            os.open(os.devnull, os.O_RDWR)
            setattr(sys, name, os.fdopen(number, 'w' if number else 'r', closefd=False))
    file = io.BufferedWriter(io.FileIO(sys.stderr.fileno(), 'w', closefd=False))
    sys.stderr = _ErrorStream(file, sys.stderr.encoding, line_buffering=True)


def _escape_unprintable() -> None:
    """Have standard output and error write characters that their encoding lacks as escapes."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors='backslashreplace')


def _print_failure(text: str, code: int) -> int:
    """Print an error as one line on standard error and return ``code``.

    After a signal nothing is printed, and the exit code is that of an interruption.
    """
    if interruption.is_stopped():
        # A library that was being loaded has made an error of its own of the signal.
        return interruption.EXIT_CODE
    print(f'ERROR: {printable(text)}', file=sys.stderr)  # noqa: T201
    return code


if __name__ == '__main__':
    sys.exit(main())
