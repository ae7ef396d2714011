# SPDX-License-Identifier: Apache-2.0
"""What the import contracts of pyproject.toml notice, the names of the house, and what an import loads."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
NAME = 'stickslip_monitor'
PACKAGES = ('stickslip_logs', NAME, 'stickslip_lab')
# What belongs to one room or to an extra, and is loaded where it is used.
HEAVY = {
    'aiohttp',
    'distributed',
    'jinja2',
    'matplotlib',
    'mcap',
    'numba',
    'pyarrow',
    'rclpy',
    'rich',
    'yaml',
}
# An import that a contract forbids: the room that has it, what it imports.
PLANTED = (
    ('stickslip_logs.recordings', 'stickslip_monitor.errors'),
    ('stickslip_logs.tables', 'stickslip_logs.recordings.recording'),
    ('stickslip_logs.tables', 'stickslip_lab.scenes.truth_topics'),
    ('stickslip_logs.recordings', 'rclpy'),
    ('stickslip_monitor.physics', 'stickslip_monitor.monitor.rule'),
    ('stickslip_monitor.physics', 'time'),
    ('stickslip_monitor.physics', 'matplotlib'),
    ('stickslip_monitor.monitor', 'stickslip_monitor.offline.check'),
    ('stickslip_monitor.monitor', 'stickslip_logs.recordings.reader'),
    ('stickslip_monitor.monitor', 'stickslip_monitor.monitor.parameter_file'),
    ('stickslip_monitor.monitor', 'socket'),
    ('stickslip_monitor.offline', 'stickslip_monitor.dashboard.server'),
    ('stickslip_monitor.offline', 'mcap'),
    ('stickslip_monitor.ros', 'stickslip_monitor.offline.check'),
    ('stickslip_monitor.links', 'stickslip_logs.tables.table_file'),
    ('stickslip_monitor.links', 'std_msgs'),
    ('stickslip_monitor.dashboard', 'stickslip_monitor.commands.check'),
    ('stickslip_monitor.drawing', 'stickslip_monitor.links.live_monitor'),
    ('stickslip_monitor.report', 'stickslip_lab.drawing.studies'),
    ('stickslip_lab.scenes', 'stickslip_lab.calibration.calibration'),
    ('stickslip_lab.friction', 'stickslip_monitor.ros.node'),
    ('stickslip_lab.calibration', 'yaml'),
)


def list_modules() -> list[Path]:
    """Return every module of the three packages, by its path in the repository."""
    return sorted(file.relative_to(ROOT) for package in PACKAGES for file in (ROOT / package).rglob('*.py'))


def list_imports(path: Path) -> set[str]:
    """Return the full names of all that a module imports, at any depth of its source."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text('utf-8'))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
    return names


def broken_contracts(folder: Path) -> str:
    """Return what import-linter says of the packages in a folder."""
    linter = shutil.which('lint-imports', path=sysconfig.get_path('scripts'))
    assert linter is not None
    command = [linter, '--no-cache', '--config', str(ROOT / 'pyproject.toml')]
    env = {'PYTHONPATH': str(folder), 'COLUMNS': '400'}
    done = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, timeout=120)
    return done.stdout if done.returncode else ''


def test_the_contracts_hold() -> None:
    assert broken_contracts(ROOT) == ''


@pytest.fixture(scope='module')
def report(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Plant every violation in a copy of the packages, a module each, and return the broken contracts."""
    folder = tmp_path_factory.mktemp('planted')
    for package in PACKAGES:
        shutil.copytree(ROOT / package, folder / package, ignore=shutil.ignore_patterns('__pycache__'))
    for number, (room, target) in enumerate(PLANTED):
        (folder / room.replace('.', '/') / f'planted_{number}.py').write_text(f'import {target}\n')
    return broken_contracts(folder)


@pytest.mark.parametrize('number', range(len(PLANTED)))
def test_a_planted_violation_is_noticed(number: int, report: str) -> None:
    room, target = PLANTED[number]
    assert re.search(rf'{re.escape(room)}\.planted_{number} -> {re.escape(target)}\b', report)


def test_no_class_and_no_module_is_named_twice() -> None:
    classes: dict[str, set[str]] = {}
    stems: dict[str, set[str]] = {}
    for path in list_modules():
        for node in ast.walk(ast.parse((ROOT / path).read_text('utf-8'))):
            if isinstance(node, ast.ClassDef) and not node.name.startswith('_'):
                classes.setdefault(node.name, set()).add(str(path))
        # A command bears the name of what it runs, and an import path of 0.3 its own.
        if (
            path.stem not in ('__init__', '__main__')
            and len(path.parts) > 2
            and path.parts[1] not in ('commands', 'bags')
        ):
            stems.setdefault(path.stem, set()).add(str(path))
    assert {name: places for name, places in classes.items() if len(places) > 1} == {}
    assert {n: p for n, p in stems.items() if len(p) > 1} == {}


def test_the_house_has_two_floors_and_the_formatter_is_right() -> None:
    assert [path for path in list_modules() if len(path.parts) > 3] == []
    lines = [
        (path, line) for path in list_modules() for line in (ROOT / path).read_text('utf-8').splitlines()
    ]
    assert [(path, line) for path, line in lines if len(line) > 110] == []
    assert [(path, line) for path, line in lines if re.search(r'# fmt: *(skip|off)', line)] == []


@pytest.mark.parametrize(
    ('folder', 'strangers'),
    [('logs', (NAME, 'stickslip_lab', 'shared', 'sending')), ('monitor', ('stickslip_lab',))],
)
def test_the_tests_of_a_package_need_none_above_it(folder: str, strangers: tuple[str, ...]) -> None:
    imports = {
        f'{path.relative_to(ROOT)}: {name}'
        for path in (ROOT / 'test' / folder).rglob('*.py')
        for name in list_imports(path)
        if name.partition('.')[0] in strangers
    }
    assert imports == set()


@pytest.mark.parametrize(('module', 'name'), [('reader', 'open_bag'), ('writer', 'BagWriter')])
def test_import_paths_of_0_3_name_their_successor(module: str, name: str) -> None:
    new = f'stickslip_logs.recordings.{module}'
    code = f'from {NAME}.bags.{module} import {name} as old; from {new} import {name}; assert old is {name}'
    command = [sys.executable, '-W', 'default', '-c', code]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    text = f'DeprecationWarning: {NAME}.bags.{module} is deprecated: import {name} from {new}'
    assert text in done.stderr


def test_importing_the_package_loads_numpy_only() -> None:
    """scipy is imported where it is used: it is worth 22 MB of the memory of a node."""
    code = (
        'import sys\n'
        'before = set(sys.modules)\n'
        f'from {NAME} import *\n'
        f'import {NAME}.live\n'
        "print(*sorted({name.split('.')[0] for name in set(sys.modules) - before}))\n"
    )
    done = subprocess.run(
        [sys.executable, '-W', 'error', '-c', code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    loaded = set(done.stdout.split())
    assert {NAME, 'numpy'} <= loaded
    assert loaded & {*HEAVY, 'scipy'} == set()
    # Beside it, the standard library, and what compiled modules bring.
    strangers = loaded - {*PACKAGES, 'numpy'} - sys.stdlib_module_names
    assert {name for name in strangers if not name.startswith(('_', 'cython'))} == set()
