# SPDX-License-Identifier: Apache-2.0
"""A log that nobody reads stops nobody."""

from __future__ import annotations

import os
import subprocess
import sys

PROGRAM = """
import sys
from stickslip_monitor.standard_error import unblocked
with unblocked():
    for k in range(int(sys.argv[1])):
        print(f'line {k:>100}', file=sys.stderr)
        sys.stderr.flush()
"""


def test_a_reader_that_stops_costs_lines_and_no_time() -> None:
    """The pipe holds 64 KiB (pipe(7)); 5 000 lines are eight of them."""
    reader, writer = os.pipe()
    with os.fdopen(reader, 'rb') as pipe:
        program = subprocess.Popen([sys.executable, '-c', PROGRAM, '5000'], stderr=writer)
        os.close(writer)
        assert program.wait(60.0) == 0
        lines = pipe.read().decode().splitlines()
    assert 0 < len(lines) < 5_000
    assert lines[0].split() == ['line', '0']


def test_a_reader_that_comes_back_reads_how_much_is_lost() -> None:
    reader, writer = os.pipe()
    done, say = os.pipe()
    wait, go = os.pipe()
    text = f"""{PROGRAM}
    import os
    os.write({say}, b'.')
    os.read({wait}, 1)
    print('the end', file=sys.stderr)
"""
    command = [sys.executable, '-c', text, '5000']
    program = subprocess.Popen(command, stderr=writer, pass_fds=(say, wait))
    os.close(writer)
    os.read(done, 1)
    os.write(go, b'.')
    with os.fdopen(reader, 'rb') as pipe:
        lines = pipe.read().decode().splitlines()
    assert program.wait(60.0) == 0
    # More may be lost while that of the first is told.
    told = [line for line in lines if line.endswith('of the log are lost: nobody read them]')]
    lost = sum(int(line[1:].split()[0]) for line in told)
    assert lost + sum(line.startswith('line ') for line in lines) == 5_000
    assert lost > 0
    assert lines[-1] == 'the end'


def test_without_standard_error_there_is_one() -> None:
    command = [sys.executable, '-c', PROGRAM, '3']
    done = subprocess.run(command, preexec_fn=lambda: os.close(2), check=False)
    assert done.returncode == 0
