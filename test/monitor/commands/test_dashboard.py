# SPDX-License-Identifier: Apache-2.0
"""The command: a recording on the page, and what it refuses."""

from __future__ import annotations

import json
import re
import sys
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from shared import CONFIG, DEADLINE, ROOT, Program

from stickslip_monitor.monitor.bearing_records import event_record
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.offline.check import check_recording

pytest.importorskip('aiohttp', reason="the extra 'dashboard' is not installed")


BAG = ROOT / 'bags' / 'history_above'
COMMAND = (sys.executable, '-m', 'stickslip_monitor.cli', 'dashboard', '--config', str(CONFIG))


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., str]]:
    """Starts a dashboard and returns its address; it is stopped when the test ends."""
    started: list[Program] = []

    def start(*arguments: str) -> str:
        program = Program([*COMMAND, '--port', '0', *arguments], tmp_path / 'log', cwd=ROOT)
        started.append(program)
        address = program.until(lambda: re.search(r'Dashboard on (http\S+)\n', program.output))
        return str(address[1])

    yield start
    for program in started:
        assert program.stop() == 0
        assert program.output.count('\n') == 1, program.output


def stream_events(url: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Kind and content of every event of a stream."""
    with urllib.request.urlopen(f'{url}events', timeout=DEADLINE) as stream:
        kind = ''
        for line in stream:
            if line.startswith(b'event: '):
                kind = line[7:].decode().strip()
            elif line.startswith(b'data: '):
                yield kind, json.loads(line[6:])


def test_a_recording_is_played_to_its_end(start: Callable[..., str]) -> None:
    url = start('--bag', str(BAG), '--rate', '600')
    for kind, document in stream_events(url):
        if kind == 'monitor' and document['finished']:
            break
    _, state = next(stream_events(url))
    assert state['source'] == {'name': str(BAG), 'replay': True}
    status = state['bearings'][0]['status']
    # The check reads the same recording in bulk.
    checked = check_recording(BAG, load_config(CONFIG)).bearings['aft_stern']
    assert status['inputs']['load']['counts']['accepted'] == checked.inputs[1].used
    assert status['reason'] == checked.events[-1].after.value == 'bistable'
    raised = [c['time'] for c in state['log'] if c['what'] == 'raise']
    expected = [event_record(event)['time'] // 10**6 for event in checked.events if event.raised]
    assert raised == expected
    # Nobody was there: what came waits, and the worse row stands for the caution that it covers.
    assert len(expected) == 2
    assert state['alarms']['unacknowledged'] == 1


def test_with_a_token_others_may_come(start: Callable[..., str], tmp_path: Path) -> None:
    file = tmp_path / 'token'
    file.touch(0o600)
    file.write_text('correct-horse-battery\n')
    url = start('--bag', str(BAG), '--host', '0.0.0.0', '--token-file', str(file))
    assert url.startswith('http://0.0.0.0:')
    request = urllib.request.Request(
        f'{url}metrics', headers={'Authorization': 'Bearer correct-horse-battery'}
    )
    with urllib.request.urlopen(request, timeout=DEADLINE) as answer:
        assert b'stickslip_monitor_up' in answer.read()
    with pytest.raises(urllib.error.HTTPError, match='401'):
        urllib.request.urlopen(f'{url}metrics', timeout=DEADLINE)
