# SPDX-License-Identifier: Apache-2.0
"""The node as a service: what it tells systemd, and what asks it how it is."""

from __future__ import annotations

import shutil
import socket
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

ROOT = Path(__file__).parents[2]
UNIT = ROOT / 'launch_configs' / 'systemd' / 'stickslip-monitor.service'


def test_systemd_hears_of_start_life_and_end(
    start: Any, kit: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / 'notify'))
        manager.settimeout(30.0)
        monkeypatch.setenv('NOTIFY_SOCKET', str(tmp_path / 'notify'))
        monkeypatch.setenv('WATCHDOG_USEC', '400000')
        monitor = start(kit.parameters())
        assert [manager.recv(100) for _ in range(4)] == [b'READY=1', *[b'WATCHDOG=1'] * 3]
        # It is said when the node monitors, not before.
        assert 'the monitor is active' in monitor.output
        monitor.stop()
        last = b''
        while last != b'STOPPING=1':
            last = manager.recv(100)


def test_health_is_asked_of_a_running_node(start: Any, kit: Any) -> None:
    monitor = start(kit.parameters())
    node = f'/{monitor.space}/stickslip_monitor'

    def health(name: str, wait: str = '20') -> tuple[int, str]:
        done = subprocess.run(
            [sys.executable, '-m', 'stickslip_monitor', 'health', '--node', name, '--timeout',
             wait, '--diagnostics', f'/{monitor.space}/diagnostics'],
            capture_output=True, text=True, timeout=60, check=False,
        )  # fmt: skip
        return done.returncode, done.stdout + done.stderr

    assert health(node) == (0, f'{node}: Monitoring.\n')
    assert health('/other', '3') == (
        2,
        f'ERROR: nothing is heard of /other for 3 s; heard of: {node}\n',
    )
    assert monitor.change_state(4)
    # An inactive node says so once, and what is said once is missed by who asks later.
    assert health(node, '3')[0] == 2


def test_the_unit_is_one_that_systemd_takes(tmp_path: Path) -> None:
    """With the program where this environment has it; and little is left open to the service."""
    analyze = shutil.which('systemd-analyze')
    if analyze is None:
        pytest.skip('systemd is not installed')
    text = UNIT.read_text('utf-8')
    program = Path(sysconfig.get_path('scripts')) / 'monitor'
    assert program.is_file()
    own = tmp_path / UNIT.name
    own.write_text(text.replace('/opt/stickslip_monitor/bin/monitor', str(program)))
    done = subprocess.run(
        [analyze, 'verify', '--man=no', own], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout + done.stderr) == (0, '')
    safe = [analyze, 'security', '--offline=true', '--threshold=20', own]
    assert subprocess.run(safe, capture_output=True, check=False).returncode == 0
