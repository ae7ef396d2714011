# SPDX-License-Identifier: Apache-2.0
"""Which part of the package may know which: every import of every module is parsed and judged."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path, PurePosixPath

import pytest

ROOT = Path(__file__).resolve().parents[1]
NAME = 'stickslip_monitor'
PACKAGE = ROOT / NAME

# Each part and what it builds on; it may also know what those build on. 'root' is the package's
# own __init__.py, which gathers the public names of the core.
BUILDS_ON: dict[str, tuple[str, ...]] = {
    'errors': (),
    'files': ('errors',),
    'arrays': ('errors',),
    'fields': ('errors',),
    'interruption': (),
    'jit': (),
    'units': (),
    'state_file': ('files',),
    'physics': ('arrays', 'jit', 'units'),
    'monitor': ('physics', 'fields', 'files'),
    'root': ('monitor',),
    'tables': ('arrays', 'fields', 'files', 'units'),
    'bags': ('monitor', 'tables'),
    'offline': ('bags', 'root'),
    'host': ('monitor',),
    'ros': ('root', 'host', 'state_file'),
    'lab': ('offline',),
    'drawing': ('lab',),
    'report': ('drawing',),
    'dashboard': ('offline', 'state_file', 'host'),
    'links': ('root', 'host'),
    'live': ('ros', 'offline'),
    'commands': ('report', 'dashboard', 'links', 'ros'),
    'cli': ('commands', 'interruption'),
    '__main__': ('cli',),
}
EVERYWHERE = {'numpy', 'scipy'}
# Where anything else from outside may be imported: prefixes of paths inside the package.
ONLY_IN = {
    'argcomplete': ('cli.py',),
    'aiohttp': ('dashboard/', 'links/'),
    'distributed': ('offline/processes.py',),
    'jinja2': ('report/',),
    'lz4': ('bags/',),
    'matplotlib': ('drawing/',),
    'mcap': ('bags/',),
    'mcap_ros2': ('bags/',),
    'prometheus_client': ('dashboard/',),
    'pyarrow': ('tables/table.py',),
    'rcl_interfaces': ('ros/',),
    'rclpy': ('ros/',),
    'rich': ('commands/', 'cli.py'),
    'std_srvs': ('ros/',),
    'yaml': ('monitor/parameter_file.py', 'bags/'),
    'zstandard': ('bags/',),
}
# The core takes time as an argument and starts nothing; only its reader of files touches one.
CORE = ('arrays', 'fields', 'physics', 'monitor')
READS_FILES = 'monitor.parameter_file'
READER = 'monitor/parameter_file.py'
READER_OF_0_2 = 'monitor/config_file.py'  # an import path that others have
NOT_IN_CORE = {'asyncio', 'datetime', 'os', 'socket', 'subprocess', 'sys', 'threading', 'time'}


@cache
def known_to(part: str) -> frozenset[str]:
    """The parts that a part may import, itself included."""
    return frozenset({part}.union(*(known_to(lower) for lower in BUILDS_ON[part])))


def modules() -> list[PurePosixPath]:
    """Every module, by its path inside the package."""
    files = sorted(PACKAGE.rglob('*.py'))
    return [PurePosixPath(file.relative_to(PACKAGE).as_posix()) for file in files]


def imports(source: str, path: PurePosixPath) -> Iterator[tuple[int, str]]:
    """Line and full name of everything imported, at any depth of the source."""
    package = [NAME, *path.parent.parts]
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            up = package[: len(package) - node.level + 1] if node.level else []
            base = '.'.join([*up, node.module] if node.module else up)
            yield from ((node.lineno, f'{base}.{alias.name}') for alias in node.names)


def part_of(path: PurePosixPath) -> str:
    """The part of the package that a module belongs to."""
    return path.parts[0] if len(path.parts) > 1 else path.stem.replace('__init__', 'root')


def violations(source: str, path: PurePosixPath) -> list[str]:
    """What a module imports against the rules, one sentence each."""
    if part_of(path) not in BUILDS_ON:
        return [f"{path} belongs to no part: give '{part_of(path)}' a row in test_layering.py"]
    found = []
    for line, name in imports(source, path):
        top, _, rest = name.partition('.')
        if rule := _inside(path, rest) if top == NAME else _outside(path, top):
            found.append(f'{path}:{line} imports {name}: {rule}')
    return found


def _inside(path: PurePosixPath, target: str) -> str:
    own, head = part_of(path), target.partition('.')[0]
    part = head if head in BUILDS_ON else 'root'
    if own in CORE and str(path) != READER_OF_0_2 and f'{target}.'.startswith(f'{READS_FILES}.'):
        return 'only adapters and commands read files'
    return '' if part in known_to(own) else f'{own} must not know {part}'


def _outside(path: PurePosixPath, name: str) -> str:
    if part_of(path) in CORE and str(path) != READER and name in NOT_IN_CORE:
        return 'the core takes time as an argument and touches nothing outside'
    if name in EVERYWHERE or name in sys.stdlib_module_names:
        return ''
    places = ('ros/',) if name.endswith('_msgs') else ONLY_IN.get(name, ())
    if str(path).startswith(places):
        return ''
    return f'belongs in {" or ".join(places)}' if places else 'not a known dependency'


def test_imports_keep_to_what_each_part_builds_on() -> None:
    found = [
        sentence
        for path in modules()
        for sentence in violations((PACKAGE / path).read_text(encoding='utf-8'), path)
    ]
    assert found == []


def test_no_module_imports_itself_in_a_circle() -> None:
    names = {
        '.'.join((NAME, *path.with_suffix('').parts)).removesuffix('.__init__'): path for path in modules()
    }
    graph: dict[str, set[str]] = {}
    for name, path in names.items():
        found = {x for _, x in imports((PACKAGE / path).read_text(encoding='utf-8'), path)}
        # 'from a import b' may name the module a.b or something inside the module a.
        targets = {x if x in names else x.rpartition('.')[0] for x in found}
        graph[name] = (targets & set(names)) - {name}
    assert len(list(TopologicalSorter(graph).static_order())) == len(names)


def test_no_class_and_no_module_is_named_twice() -> None:
    classes: dict[str, set[str]] = {}
    stems: dict[str, set[str]] = {}
    for path in modules():
        for node in ast.walk(ast.parse((PACKAGE / path).read_text(encoding='utf-8'))):
            if isinstance(node, ast.ClassDef) and not node.name.startswith('_'):
                classes.setdefault(node.name, set()).add(str(path))
        # A command bears the name of what it runs.
        if path.stem not in ('__init__', '__main__') and path.parts[0] != 'commands':
            stems.setdefault(path.stem, set()).add(str(path))
    assert {name: places for name, places in classes.items() if len(places) > 1} == {}
    assert {n: p for n, p in stems.items() if len(p) > 1} == {}


def test_the_house_has_two_floors_and_the_formatter_is_right() -> None:
    assert [path for path in modules() if len(path.parts) > 2] == []
    lines = [(path, line) for path in modules() for line in (PACKAGE / path).read_text('utf-8').splitlines()]
    assert [(path, line) for path, line in lines if len(line) > 110] == []
    assert [(path, line) for path, line in lines if re.search(r'# fmt: *(skip|off)', line)] == []


@pytest.mark.parametrize(
    ('path', 'source', 'words'),
    [
        ('physics/a.py', f'from {NAME}.monitor.parameters import x', 'physics must not know monitor'),
        ('physics/a.py', f'from {NAME} import Bearing', 'physics must not know root'),
        ('physics/a.py', 'def f():\n    import matplotlib.pyplot', 'belongs in drawing/'),
        ('monitor/a.py', 'import time', 'time as an argument'),
        ('monitor/a.py', 'from .parameter_file import load_config', 'only adapters and commands'),
        ('monitor/a.py', 'import pandas', 'not a known dependency'),
        ('bags/a.py', 'from std_msgs.msg import Float64', 'belongs in ros/'),
        ('lab/a.py', 'from ..ros import node', 'lab must not know ros'),
        ('odd/a.py', 'import math', 'belongs to no part'),
    ],
)
def test_a_planted_violation_is_noticed(path: str, source: str, words: str) -> None:
    (text,) = violations(f'import math\n{source}\n', PurePosixPath(path))
    assert words in text
    assert text.startswith(path)


def test_importing_the_package_loads_numpy_and_scipy_only() -> None:
    code = (
        'import sys\n'
        'before = set(sys.modules)\n'
        f'from {NAME} import *\n'
        "print(*sorted({name.split('.')[0] for name in set(sys.modules) - before}))\n"
    )
    done = subprocess.run(
        [sys.executable, '-W', 'error', '-c', code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    loaded = set(done.stdout.split())
    assert {NAME, *EVERYWHERE} <= loaded
    assert loaded & set(ONLY_IN) == set()
    # Beside the two, the standard library and what their own compiled modules bring.
    strangers = loaded - {NAME, *EVERYWHERE} - sys.stdlib_module_names
    assert {name for name in strangers if not name.startswith(('_', 'cython'))} == set()
