# SPDX-License-Identifier: Apache-2.0
"""The page benchmarks/results.md: on what machine, and a section for each part."""

from __future__ import annotations

import os
import platform
import re
import subprocess
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PAGE = Path(__file__).with_name('results.md')
PACKAGES = ('numpy', 'scipy', 'mcap', 'rosbags', 'numba', 'pathsim', 'ros-kilted-rclpy')
DEBIAN = ('auto-07p', 'python3-siconos')
_HEAD = """\
# Results of the benchmarks

Written by `make bench` and `make bench-soak`. A ratio is the other program's time over ours.

"""


def describe_machine() -> str:
    """Return the line that says where the numbers come from."""
    versions = [
        f'{name} {installed}' for name in PACKAGES if (installed := _installed_version(name))
    ] + _list_debian_packages()
    return (
        f'Machine: {_read_processor()}, {os.cpu_count()} cores, {platform.system()}'
        f' {platform.release()}, Python {platform.python_version()}.\nVersions: ' + ', '.join(versions) + '.'
    )


def render(sections: Mapping[str, str], order: tuple[str, ...], old: str = '') -> str:
    """Return the page.

    Args:
        sections: New sections by the name of their part.
        order: The names of all parts.
        old: The page until now, whose other sections are kept if they are of the same machine.
    """
    machine_line = describe_machine()
    old_sections = split_sections(old) if machine_line in old else {}
    all_sections = old_sections | dict(sections)
    body = [
        f'<!-- part: {name} -->\n\n{all_sections[name].strip()}\n' for name in order if name in all_sections
    ]
    return '\n'.join([_HEAD + machine_line + '\n', *body])


def split_sections(page: str) -> dict[str, str]:
    """Return the sections of a page as text, by the names of their parts, in its order."""
    parts = re.split(r'^<!-- part: (\w+) -->$', page, flags=re.MULTILINE)[1:]
    return dict(zip(parts[::2], parts[1::2], strict=True))


def _installed_version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ''


def _list_debian_packages() -> list[str]:
    """Return name and version of those of Debian's packages that are installed."""
    try:
        command = ['dpkg-query', '-W', '-f', '${Package} ${Version}\n', *DEBIAN]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError:
        return []
    return [line for line in done.stdout.splitlines() if len(line.split()) > 1]


def _read_processor() -> str:
    path = Path('/proc/cpuinfo')
    for line in path.read_text('utf-8').splitlines() if path.exists() else ():
        if line.startswith('model name'):
            return line.partition(':')[2].strip()
    return platform.machine()
