# SPDX-License-Identifier: Apache-2.0
"""The layers point one way: every import of every module is parsed and judged by these rules."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path, PurePosixPath

import pytest

ROOT = Path(__file__).resolve().parents[1]
NAME = 'stickslip_monitor'
PACKAGE = ROOT / NAME

# Parts by layer; a part may import itself and what lies below. 'root' is the package's own
# __init__.py, which gathers the public names of the core.
LAYER = {
    'errors': 0,
    'physics': 1,
    'monitor': 2,
    'root': 3,
    'surface_store': 3,
    'bags': 4,
    'ros': 4,
    'dashboard': 4,
    'drawing': 4,
    'fleet': 4,
    'report': 4,
    'scenes': 4,
    'study': 4,
    'commands': 5,
    'cli': 6,
    'live': 6,
    '__main__': 7,
}
ADAPTERS = {part for part, layer in LAYER.items() if layer == 4}
# The only arrows from one adapter to another.
ACROSS = {('scenes', 'bags.writer'), ('scenes', 'bags.cdr')}
# Of the core, bags may know how a field is named; only the bag check, and what writes
# verdicts, know the monitor.
BAGS_OF_MONITOR = 'monitor.fields'
BAG_CHECKS = ('bags/check.py', 'bags/clips.py', 'bags/verdicts.py')
YAML_READER = 'monitor/config_file.py'

EVERYWHERE = {'numpy', 'scipy'}
# Where anything else from outside may be imported: prefixes of paths inside the package.
ONLY_IN = {
    'aiohttp': ('dashboard/',),
    'distributed': ('fleet.py',),
    'jinja2': ('report/',),
    'lz4': ('bags/',),
    'matplotlib': ('drawing/',),
    'mcap': ('bags/',),
    'mcap_ros2': ('bags/',),
    'prometheus_client': ('dashboard/',),
    'rcl_interfaces': ('ros/',),
    'rclpy': ('ros/',),
    'rich': ('commands/', 'cli.py'),
    'std_srvs': ('ros/',),
    'yaml': (YAML_READER, 'bags/'),
    'zstandard': ('bags/',),
}
# The core takes time as an argument and starts nothing.
NOT_IN_CORE = {'asyncio', 'datetime', 'os', 'socket', 'subprocess', 'sys', 'threading', 'time'}


def modules() -> list[PurePosixPath]:
    """Every module, by its path inside the package."""
    files = sorted(PACKAGE.rglob('*.py'))
    return [PurePosixPath(file.relative_to(PACKAGE).as_posix()) for file in files]


def dotted(path: PurePosixPath) -> str:
    """Name of a module inside the package; empty for the package itself."""
    return '.'.join(path.with_suffix('').parts).removesuffix('__init__').removesuffix('.')


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
    if part_of(path) not in LAYER:
        return [f"{path} belongs to no layer: give '{part_of(path)}' one in test_layering.py"]
    found = []
    for line, name in imports(source, path):
        inside, _, rest = name.partition('.')
        rule = _inside(path, rest) if inside == NAME else _outside(path, inside)
        if rule:
            found.append(f'{path}:{line} imports {name}: {rule}')
    return found


def _inside(path: PurePosixPath, target: str) -> str:
    own, head = part_of(path), target.partition('.')[0]
    part = head if head in LAYER else 'root'
    if part == own:
        reads_yaml = f'{target}.'.startswith('monitor.config_file.') and own == 'monitor'
        return 'only adapters and commands read files' if reads_yaml else ''
    if own == 'bags' and part == 'monitor' and str(path) not in BAG_CHECKS:
        return '' if f'{target}.'.startswith(BAGS_OF_MONITOR + '.') else 'bags know only fields'
    if LAYER[part] > LAYER[own]:
        return f'{own} lies below {part}'
    if part in ADAPTERS and own in ADAPTERS:
        allowed = any(own == a and f'{target}.'.startswith(f'{b}.') for a, b in ACROSS)
        return '' if allowed else 'adapters do not know each other'
    return ''


def _outside(path: PurePosixPath, name: str) -> str:
    core = part_of(path) in ('physics', 'monitor') and str(path) != YAML_READER
    if core and name in NOT_IN_CORE:
        return 'the core takes time as an argument and touches nothing outside'
    if name in EVERYWHERE or name in sys.stdlib_module_names:
        return ''
    places = ('ros/',) if name.endswith('_msgs') else ONLY_IN.get(name, ())
    if str(path).startswith(places):
        return ''
    return f'belongs in {" or ".join(places)}' if places else 'not a known dependency'


@pytest.mark.parametrize('path', modules(), ids=str)
def test_imports_keep_the_layers(path: PurePosixPath) -> None:
    assert violations((PACKAGE / path).read_text(encoding='utf-8'), path) == []


def test_no_module_imports_itself_in_a_circle() -> None:
    names = {f'{NAME}.{dotted(path)}'.rstrip('.'): path for path in modules()}
    graph: dict[str, set[str]] = {}
    for name, path in names.items():
        found = {x for _, x in imports((PACKAGE / path).read_text(encoding='utf-8'), path)}
        # 'from a import b' may name the module a.b or something inside the module a.
        targets = {x if x in names else x.rpartition('.')[0] for x in found}
        graph[name] = (targets & set(names)) - {name}
    order = list(TopologicalSorter(graph).static_order())
    assert len(order) == len(names)


@pytest.mark.parametrize(
    ('path', 'source', 'words'),
    [
        ('physics/a.py', f'from {NAME}.monitor.config import x', 'physics lies below monitor'),
        ('physics/a.py', f'import {NAME}.monitor', 'physics lies below monitor'),
        ('physics/a.py', f'from {NAME} import Bearing', 'physics lies below root'),
        ('physics/a.py', 'from .. import monitor', 'physics lies below monitor'),
        ('physics/a.py', 'from ..monitor.config import x', 'physics lies below monitor'),
        ('physics/a.py', 'def f():\n    import matplotlib.pyplot', 'belongs in drawing/'),
        ('physics/a.py', 'import yaml', 'belongs in monitor/config_file.py or bags/'),
        ('monitor/a.py', f'from {NAME}.ros.node import x', 'monitor lies below ros'),
        ('monitor/a.py', 'import yaml', 'belongs in monitor/config_file.py or bags/'),
        ('monitor/a.py', 'import time', 'time as an argument'),
        ('monitor/a.py', 'from .config_file import load_config', 'only adapters and commands'),
        ('monitor/a.py', f'from {NAME}.monitor import config_file', 'only adapters and commands'),
        ('monitor/a.py', 'import pandas', 'not a known dependency'),
        ('errors.py', f'from {NAME}.physics.rules import x', 'errors lies below physics'),
        ('__init__.py', f'from {NAME}.bags.reader import x', 'root lies below bags'),
        ('bags/a.py', f'from {NAME}.ros import node', 'adapters do not know each other'),
        ('bags/a.py', f'from {NAME}.monitor.monitor import Monitor', 'bags know only fields'),
        ('bags/a.py', 'from std_msgs.msg import Float64', 'belongs in ros/'),
        ('scenes/a.py', f'from {NAME}.bags.reader import x', 'adapters do not know each other'),
        ('scenes/a.py', f'from {NAME}.bags import x', 'adapters do not know each other'),
        ('scenes/effects/a.py', 'from ...ros import node', 'adapters do not know each other'),
        ('scenes/a.py', f'from {NAME}.commands.output import x', 'scenes lies below commands'),
        ('scenes/a.py', 'import yaml', 'belongs in monitor/config_file.py or bags/'),
        ('ros/a.py', 'from mcap.reader import make_reader', 'belongs in bags/'),
        ('ros/a.py', f'from {NAME}.cli import main', 'ros lies below cli'),
        ('drawing/a.py', f'from {NAME}.scenes import x', 'adapters do not know each other'),
        ('report/a.py', f'from {NAME}.bags.check import x', 'adapters do not know each other'),
        ('report/a.py', f'from {NAME}.drawing.svg import x', 'adapters do not know each other'),
        ('commands/a.py', 'import jinja2', 'belongs in report/'),
        ('drawing/a.py', 'from rich.table import Table', 'belongs in commands/ or cli.py'),
        ('commands/a.py', 'import rclpy', 'belongs in ros/'),
        ('commands/a.py', 'import matplotlib', 'belongs in drawing/'),
        ('commands/a.py', f'from {NAME}.cli import main', 'commands lies below cli'),
        ('odd/a.py', 'import math', 'belongs to no layer'),
    ],
)
def test_a_planted_violation_is_noticed(path: str, source: str, words: str) -> None:
    (text,) = violations(f'import math\n{source}\n', PurePosixPath(path))
    assert words in text
    assert text.startswith(path)


@pytest.mark.parametrize(
    ('path', 'source'),
    [
        ('physics/a.py', f'import numpy as np\nfrom {NAME}.errors import PhysicsError'),
        ('physics/a.py', f'from {NAME}.physics import stribeck\nfrom .rules import x'),
        ('monitor/a.py', f'from {NAME}.physics.friction import x\nfrom scipy.special import i1e'),
        ('monitor/config_file.py', 'import yaml'),
        ('__init__.py', f'from {NAME}.monitor.monitor import Monitor'),
        (
            'bags/a.py',
            f'from {NAME}.monitor.fields import FieldPath\nimport mcap, mcap_ros2, yaml',
        ),
        ('bags/check.py', f'from {NAME}.monitor.monitor import Monitor'),
        ('scenes/a.py', f'from {NAME}.bags.writer import BagWriter\nimport time'),
        ('scenes/a.py', f'from {NAME}.bags import writer'),
        ('ros/a.py', f'import rclpy\nimport std_msgs.msg\nfrom {NAME}.monitor import monitor'),
        ('drawing/a.py', 'from matplotlib.figure import Figure'),
        ('commands/a.py', f'import rich\nfrom {NAME}.ros import node\nfrom {NAME}.bags import x'),
        ('cli.py', f'from {NAME}.commands import assess\nfrom {NAME} import __version__'),
    ],
)
def test_what_is_allowed_is_let_through(path: str, source: str) -> None:
    assert violations(source, PurePosixPath(path)) == []


def test_importing_the_package_loads_numpy_and_scipy_only() -> None:
    code = (
        'import sys\n'
        'before = set(sys.modules)\n'
        f'import {NAME}\n'
        "print(*sorted({name.split('.')[0] for name in set(sys.modules) - before}))\n"
    )
    done = subprocess.run(
        [sys.executable, '-W', 'error', '-c', code],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    loaded = set(done.stdout.split())
    assert {NAME, *EVERYWHERE} <= loaded
    assert loaded & set(ONLY_IN) == set()
    # Beside the two, the standard library and what their own compiled modules bring.
    strangers = loaded - {NAME, *EVERYWHERE} - sys.stdlib_module_names
    assert {name for name in strangers if not name.startswith(('_', 'cython'))} == set()
