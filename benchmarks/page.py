# SPDX-License-Identifier: Apache-2.0
"""docs/benchmarks.md: a head that says on what machine, and a section for each part."""

from __future__ import annotations

import os
import platform
import re
import subprocess
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PAGE = Path(__file__).resolve().parents[1] / 'docs' / 'benchmarks.md'
PACKAGES = (
    'numpy',
    'scipy',
    'mcap',
    'mcap-ros2-support',
    'zstandard',
    'rosbags',
    'numba',
    'pathsim',
    'dask',
    'ros-kilted-rclpy',
    'ros-kilted-rmw-fastrtps-cpp',
)
DEBIAN = ('auto-07p', 'gfortran', 'python3-siconos')
INTRO = """\
# Benchmarks

Made by `make bench`, which installs what it compares with (the extra `bench`), runs every
comparison and writes this page. AUTO-07p takes part where Debian's `auto-07p` and `gfortran` are
installed, Siconos where `python3-siconos` is. `python -m benchmarks --quick` prints a short run
instead, `--only reading,diagram` makes some sections again, and `make bench-soak` adds ten minutes
at 1 kHz. The programs compared take turns within one run, so that other load on the machine
affects them alike. A ratio is the other program's time divided by ours, unless its heading says
otherwise.
"""


def machine() -> str:
    """The line that says where the numbers come from."""
    versions = [f'{name} {found}' for name in PACKAGES if (found := _version(name))] + _debian()
    return (
        f'Machine: {_processor()}, {os.cpu_count()} cores, {platform.system()}'
        f' {platform.release()}, Python {platform.python_version()}.\nVersions: '
        + ', '.join(versions)
        + '.'
    )


def render(sections: Mapping[str, str], order: tuple[str, ...], old: str = '') -> str:
    """The page.

    Args:
        sections: New sections by the name of their part.
        order: The names of all parts.
        old: The page until now, whose other sections are kept if they are of the same machine.
    """
    where = machine()
    kept = _sections(old) if where in old else {}
    found = kept | dict(sections)
    body = [f'<!-- part: {name} -->\n\n{found[name].strip()}\n' for name in order if name in found]
    return '\n'.join([INTRO, where + '\n', *body])


def _sections(page: str) -> dict[str, str]:
    parts = re.split(r'^<!-- part: (\w+) -->$', page, flags=re.MULTILINE)[1:]
    return dict(zip(parts[::2], parts[1::2], strict=True))


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ''


def _debian() -> list[str]:
    """Name and version of those of Debian's packages that are installed."""
    try:
        command = ['dpkg-query', '-W', '-f', '${Package} ${Version}\n', *DEBIAN]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError:
        return []
    return [line for line in done.stdout.splitlines() if len(line.split()) > 1]


def _processor() -> str:
    path = Path('/proc/cpuinfo')
    for line in path.read_text('utf-8').splitlines() if path.exists() else ():
        if line.startswith('model name'):
            return line.partition(':')[2].strip()
    return platform.machine()
