# SPDX-License-Identifier: Apache-2.0
"""Read thousands of mutants within limits of memory and time, those of MCAP beside its own reader.

Each is opened and read, one of sixteen checked through the command line. What fails is kept in build/fuzz.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import io
import multiprocessing
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import FrameType

from fuzz.bags import random_difference
from fuzz.corpus import ODD
from fuzz.logs import databases
from fuzz.mutants import mutant
from fuzz.oracle import difference, digest
from fuzz.ships import random_differences
from fuzz.verdicts import voyage_fault
from fuzz.voyages import QUIET_RPM, STICKING_RPM, VOYAGES
from stickslip_monitor.cli import main as stickslip
from stickslip_monitor.monitor import statements
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.monitor.parameters import MonitorConfig
from stickslip_monitor.physics.cycles import exact_amplitude

ROOT = Path(__file__).resolve().parents[1]
CONFIG = ROOT / 'launch_configs' / 'reference_bearing.yaml'
_SPEED, _LOAD = 'speed: {topic: /shaft/speed', 'load: {topic: /bearing/aft_stern/load'
# A bus does not say whether its speed is the shaft's and its load the bearing's, and canboat's has none:
# without a name it is a question, never an all-clear.
_WRITTEN: dict[str, dict[str, str]] = {
    'signalk': {
        _SPEED: f'{_SPEED}, column: propulsion.0.revolutions',
        _LOAD: f'{_LOAD}, column: propulsion.0.bearing.load',
    },
    'canboat': {_SPEED: f'{_SPEED}, column: 127488.engine.0.Speed', _LOAD: 'load: {constant: 1000.0'},
    'candump': {_LOAD: 'load: {constant: 1000.0'},
}
FAILED = ROOT / 'build' / 'fuzz'
SECONDS = 10
MEGABYTES = 500
_BATCH = 2500
# Address space is more than memory: numpy's threads reserve some.
_ADDRESS_SPACE = 3 << 30


_FOLDER = tempfile.TemporaryDirectory()


class _TooSlow(Exception):
    pass


def sources() -> list[bytes]:
    """Return the recordings of which mutants are made.

    No large ones: MCAP's reader has no limits, and what it takes would be laid to our account.
    """
    return [case.make() for case in ODD.values()]


SOURCES = {'mcap': sources, 'db3': databases}
"""What mutants are made of, by the ending of their names."""


def judge(path: Path, is_run: bool = True) -> str:
    """Describe what is wrong with how a recording is read; return an empty text if nothing.

    Args:
        path: A mutant of the recording.
        is_run: Whether the command is run too, which takes longer than the rest.
    """
    return _within_limits(lambda: difference(path) or (_run_check(path, '') if is_run else ''))


def judge_voyage(path: Path, is_quiet: bool, is_run: bool = True) -> str:
    """Describe what is wrong with how a voyage is read; return an empty text if nothing.

    Args:
        path: A mutant of the voyage.
        is_quiet: Whether the voyage has no stick-slip.
        is_run: Whether the command is run too, which takes longer than the rest.
    """
    kind = path.suffix[1:]
    return _within_limits(
        lambda: (
            voyage_fault(path, kind, _config_of(kind), is_quiet) or (_run_check(path, kind) if is_run else '')
        )
    )


def _within_limits(find_fault: Callable[[], str]) -> str:
    """Return what a function finds, or that it takes too long or fails."""
    try:
        with _limit_time(SECONDS):
            return find_fault()
    except _TooSlow:
        return f'not done in {SECONDS} s'
    except Exception:  # Any is a finding: no traceback may reach a user.
        return traceback.format_exc()


@functools.cache
def config_file(kind: str) -> str:
    """Return the path of the configuration of the reference bearing, with the columns of a bus."""
    if kind not in _WRITTEN:
        return str(CONFIG)
    text = CONFIG.read_text()
    for default, replacement in _WRITTEN[kind].items():
        text = text.replace(default, replacement)
    path = Path(_FOLDER.name) / f'{kind}.yaml'
    path.write_text(text)
    return str(path)


@functools.cache
def _config_of(kind: str) -> MonitorConfig:
    return load_config(config_file(kind))


def _run_check(path: Path, kind: str) -> str:
    """Return what is wrong with how the command tells of a recording."""
    output, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
        code = stickslip(['check', str(path), '--config', config_file(kind), '--traceback'])
    text = output.getvalue() + errors.getvalue()
    if code not in (0, 1, 2) or 'Traceback' in text:
        return f'exit code {code}: {text}'
    if any(not letter.isprintable() and letter != '\n' for letter in text):
        return 'letters that do something to a terminal'
    return '' if code != 2 or 'ERROR: ' in text else 'exit code 2 without a sentence'


@contextlib.contextmanager
def _limit_time(seconds: int) -> Iterator[None]:
    def raise_too_slow(_: int, __: FrameType | None) -> None:
        raise _TooSlow

    # Of the processor, so that a busy machine fails nothing.
    old_handler = signal.signal(signal.SIGPROF, raise_too_slow)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, old_handler)


def live_batch(seed: int, first: int, count: int, kind: str) -> list[tuple[int, str]]:
    """Compare some random ships or recordings live and in bulk; return number and text of each difference."""
    failed = []
    with tempfile.TemporaryDirectory() as folder:
        for number in range(first, first + count):
            case_seed = (seed << 32) + number
            texts = (
                [random_difference(Path(folder), case_seed)]
                if kind == 'mcap'
                else random_differences(Path(folder), kind, case_seed)
            )
            failed += [(number, '; '.join(texts))] if any(texts) else []
    return failed


def batch(
    seed: int, first: int, count: int, kind: str = 'mcap', is_voyage: bool = False
) -> list[tuple[int, str]]:
    """Judge some mutants; return number and reason of each that fails."""
    resource.setrlimit(resource.RLIMIT_AS, (_ADDRESS_SPACE, _ADDRESS_SPACE))
    # Half of a voyage's time went into the same cycles again and again.
    statements.exact_amplitude = functools.cache(exact_amplitude)
    failed = list[tuple[int, str]]()
    originals = (
        [VOYAGES[kind](speeds) for speeds in (QUIET_RPM, STICKING_RPM)] if is_voyage else [SOURCES[kind]()]
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f'mutant.{kind}'
        for number in range(first, first + count):
            # Every other voyage is quiet.
            is_quiet = is_voyage and number % 2 == 0
            data = mutant((seed << 32) + number, originals[0 if is_quiet else -1], kind)
            path.write_bytes(data)
            # One of sixteen, of either voyage.
            is_run = number % 32 < 2
            text = judge_voyage(path, is_quiet, is_run) if is_voyage else judge(path, is_run)
            used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10
            if not text and used > MEGABYTES:
                text = f'{used} MB'
            if text:
                failed.append((number, text))
                FAILED.mkdir(parents=True, exist_ok=True)
                (FAILED / f'{number}-{digest(data)}.{kind}').write_bytes(data)
    return failed


def _run_batch(call: tuple[int, int, int, str, str]) -> list[tuple[int, str]]:
    *numbers, kind, mode = call
    return live_batch(*numbers, kind) if mode == 'live' else batch(*numbers, kind, mode == 'voyages')


def main(argv: Sequence[str] | None = None) -> int:
    """Run the fuzzer; return 1 if anything failed."""
    parser = argparse.ArgumentParser(prog='python -m fuzz', description=__doc__)
    parser.add_argument('--seed', type=int, default=int(time.time()), help='default: the time')
    parser.add_argument('--count', type=int, default=5000, help='mutants of each kind (default 5000)')
    parser.add_argument('--kind', choices=VOYAGES, help='default: all')
    modes = parser.add_mutually_exclusive_group()
    modes.add_argument(
        '--voyages', action='store_true', help='of a voyage with stick-slip, and of a quiet one'
    )
    modes.add_argument(
        '--live', action='store_true', help='random voyages, to be judged live as from their logs'
    )
    args = parser.parse_args(argv)
    mode = 'live' if args.live else 'voyages' if args.voyages else 'recordings'
    kinds = {'live': ['nmea', 'signalk', 'mcap'], 'voyages': list(VOYAGES), 'recordings': list(SOURCES)}[mode]
    if args.kind not in (None, *kinds):
        parser.error(f'--kind {args.kind}: {mode} are of {", ".join(kinds)}; --voyages has every kind')
    kinds = [args.kind] if args.kind else kinds
    sys.stdout.write(f'seed {args.seed}, {args.count} {mode} of {", ".join(kinds)}\n')
    starts = range(0, args.count, _BATCH)
    calls = [
        (args.seed, first, min(_BATCH, args.count - first), kind, mode) for kind in kinds for first in starts
    ]
    count = 0
    # A process for each batch: what one takes in memory is not the next one's.
    with multiprocessing.get_context('spawn').Pool(2, maxtasksperchild=1) as pool:
        for call, failed in zip(calls, pool.imap(_run_batch, calls), strict=True):
            sys.stdout.write(f'{call[3]} {call[1] + call[2]} of {args.count}\n')
            for number, text in failed:
                count += 1
                sys.stdout.write(f'mutant {number}: {text}\n')
            sys.stdout.flush()
    sys.stdout.write(f'{count} failed; mutants are in {FAILED}\n' if count else 'none failed\n')
    return int(count > 0)
