#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes what docs/ has from the program: parameters, the rooms of the house, what the tutorial prints."""

from __future__ import annotations

import contextlib
import io
import json
import math
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterable, Iterator
from itertools import takewhile
from pathlib import Path
from typing import Any

from stickslip_monitor.links.links_config import INPUT_PARAMETERS, LINK_PARAMETERS
from stickslip_monitor.monitor.alarm_states import LIFE, AlarmState
from stickslip_monitor.monitor.parameters import BEARING_PARAMETERS, NODE_PARAMETERS
from stickslip_monitor.monitor.parameters import INPUT_PARAMETERS as INPUTS
from stickslip_monitor.monitor.record_fields import (
    ASSESSMENT,
    BEARING,
    BELIEF,
    LEVEL,
    WARNING,
    WATER,
    RecordField,
    schema_of,
)
from stickslip_monitor.monitor.value_check import REQUIRED, Parameter

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ('stickslip_logs', 'stickslip_monitor', 'stickslip_lab')
PAGE = ROOT / 'docs' / 'configuration.md'
RULE = PAGE.with_name('rule.md')
SHIP = PAGE.with_name('ship.md')
INTERFACES = PAGE.with_name('interfaces.md')
DESIGN = PAGE.with_name('design.md')
TUTORIAL = PAGE.with_name('tutorial.md')
PICTURE = ROOT / 'docs' / 'images' / 'tutorial.png'
COMMAND = 'python scripts/make_docs.py'
KINDS = {'int': 'integer', 'bool': '', 'str': '', 'float[]': 'list', 'str[]': 'list'}
INPUT = '<input>'
GROUPS = (
    ('', 'The bearing', 'The [mass-spring model](physics.md) of the lining.'),
    (
        'friction',
        'Friction',
        '`stribeck` takes static, kinetic, decay (and viscous, exponent); `coulomb` static, kinetic;'
        ' `tabulated` speed and coefficient. Others are named at the start.',
    ),
    (
        'water_temperature',
        'Water temperature',
        'With `friction.at_temperature` friction goes by the'
        ' [present water](physics.md#another-load-or-temperature). Before the first value the constant'
        ' counts, else the water of the measurement; after the timeout the last value. Both are reported,'
        ' with WARN at least.',
    ),
    (
        'tolerance',
        'What is not known',
        '[Tolerances](calibration.md#tolerances) give the verdict as probabilities.',
    ),
    (
        INPUT,
        'Inputs: speed, load, level and water temperature',
        'Where they differ, in this order. `level` is [of vibration](rule.md#measured-vibration).',
    ),
    ('level', 'Level of measured vibration', ''),
    ('alarm', 'Alarm', ''),
)

INTRO = f"""\
<!-- Made by `{COMMAND}` from stickslip_monitor/monitor/parameters.py: edit that, or the script. -->
# Configuration

One ROS 2 parameter file serves the node (`--params-file`; launch file: `config:=`) and every command
(`--config`).

```yaml
/**:
  ros__parameters:
    bearings: [aft_stern, forward_stern]

    aft_stern:
      mass: 50.0                  # kg
      damping: 400.0              # N s/m
      stiffness: 2.0e6            # N/m
      journal_diameter: 0.100     # m
      friction: {{law: stribeck, static: 0.30, kinetic: 0.10, decay: 10.0}}
      speed: {{topic: /shaft/speed, unit: rpm}}
      load: {{topic: /bearing/aft_stern/load, unit: kN}}
      alarm: {{caution_margin: 0.15, amplitude_limit: 0.9e-3, minimum_speed: 0.003}}

    forward_stern:
      mass: 40.0
      damping: 350.0
      stiffness: 1.8e6
      journal_diameter: 0.100
      friction:
        law: tabulated
        speed: [0.0, 0.05, 0.1, 0.2, 0.4, 0.8]               # m/s
        coefficient: [0.31, 0.22, 0.17, 0.13, 0.11, 0.105]
      speed:
        topic: /shaft/joint_states
        type: sensor_msgs/msg/JointState
        field: velocity[0]
        unit: rad/s
      load:
        topic: /bearing/forward_stern/wrench
        type: geometry_msgs/msg/WrenchStamped
        field: wrench.force.z
        unit: N
        scale: -1.0               # it counts upwards
        offset: 120.0             # unloaded
```

## How the file is read

- Sections `/**`, `/*`, and those that end with the node's name (`/ns/stickslip_monitor`) are merged in
  order. Others, and parameters of every ROS 2 node (`use_sim_time`, ...), are ignored.
- `friction: {{law: coulomb}}` and `friction.law: coulomb` are the same.
- An invalid file (unknown parameter, value out of range, key given twice, alias `*name`) is refused, with
  exit code 2 and a sentence.
- An input is `scale * number + offset` in its `unit`. A speed in rpm, rad/s or Hz is the shaft's, one in
  m/s the surface's. Speeds astern are negative; a load of zero or below means no contact.
- A load that nothing measures is `load: {{constant: 30, unit: kN}}`, or from the alignment calculation
  `load: {{over_speed: [[0, 32], [60, 28], [120, 19]], unit: kN}}` (rpm and load). For the node the pairs
  are one list, `[0.0, 32.0, 60.0, 28.0, 120.0, 19.0]`.
- The lists below have default, unit or range in brackets. *Live* parameters can be set at any time
  (`ros2 param set`); alarms and delays go on. *Fixed* ones are read when the node starts. For the others
  deactivate and activate the node.
"""


LIFECYCLE = re.compile(r'(?<=-->\n).*?(?=<!-- /lifecycle -->)', re.DOTALL)
LINKS = re.compile(r'(?<=-->\n)[^<]*(?=<!-- /links -->)')
DIAGNOSTICS = re.compile(r'(?<=-->\n)[^<]*(?=<!-- /diagnostics -->)')
NEEDED = {
    '': 'Always',
    BELIEF: 'With tolerances or a calibration',
    LEVEL: 'With a level',
    WATER: 'With a water temperature',
}
"""What a bearing must have for a diagnostic key, by what the field needs."""
CELL = re.compile(r'^```python\n(?P<code>.*?)^```\n(?:\n```text\n.*?```\n)?', re.DOTALL | re.MULTILINE)
SIZE = re.compile(r'^\| `([\w/]+)` \| (\d+) \| ([\d,]+) \|$', re.MULTILINE)


def _format_number(value: float) -> str:
    return '.inf' if math.isinf(value) else f'{value:g}'.replace('e+0', 'e').replace('e+', 'e')


def _format_default(row: Parameter) -> str:
    if row.default is REQUIRED:
        return '*required*'
    if row.is_optional:
        left_out = {'level.threshold': '*its rise*', 'speed.maximum': '*3000 rpm*'}
        otherwise = '*by law*' if row.name.startswith('friction.') else '*none*'
        return '*all*' if row.name.endswith('.where') else left_out.get(row.name, otherwise)
    if isinstance(row.default, bool):
        return f'`{str(row.default).lower()}`'
    if row.default == '':
        return '*none*'
    return f'`{row.default if isinstance(row.default, str) else _format_number(row.default)}`'


def _format_values(row: Parameter) -> str:
    """Return the default of a parameter with its choices or unit, else its kind or a bare number's range."""
    default = _format_default(row)
    if row.choices:
        choices = [f'`{choice}`' for choice in row.choices]
        other_choices = ', '.join(choice for choice in choices if choice != default)
        return f'{default}, or {other_choices}' if default in choices else f'{default}: {other_choices}'
    if row.unit:
        return f'{default}, {row.unit}' if default.startswith('*') else f'{default} {row.unit}'
    kind = KINDS.get(row.kind, f'{_format_number(row.minimum)} to {_format_number(row.maximum)}')
    return f'{default}, {kind}' if kind else default


def _format_cells(row: Parameter) -> tuple[str, ...]:
    live = 'live' if row.live else 'fixed' if row.fixed else ''
    return (f'`{row.name}`', _format_values(row), live, row.text)


def _shared_rows() -> Iterator[tuple[Parameter, ...]]:
    """Yield the parameters that all inputs have, each of all inputs."""
    for rows in zip(*INPUTS.values(), strict=False):
        if len({row.name.partition('.')[2] for row in rows}) == 1:
            yield rows


def _input_rows() -> Iterator[tuple[str, ...]]:
    """Return a row for the parameters that all inputs have."""
    for rows in _shared_rows():
        name = rows[0].name.partition('.')[2]
        cells = [
            tuple(dict.fromkeys(filter(None, column)))
            for column in zip(*map(_format_cells, rows), strict=True)
        ]
        text = rows[0].text.replace('the speed', 'the quantity')
        joined = (' / '.join(cell) for cell in cells[1:-1])
        yield (f'`{INPUT}.{name}`', *joined, text)


def _format_list(rows: Iterable[Parameter | tuple[str, ...]]) -> str:
    """Return a list of parameters; a sentence says what all have: one default, or that they are live."""
    cells = [row if isinstance(row, tuple) else _format_cells(row) for row in rows]
    if len(cells) > 2 and len({row[1:3] for row in cells}) == 1:
        texts = [text.split() for *_, text in cells]
        count = len(list(takewhile(lambda words: len(set(words)) == 1, zip(*texts, strict=False))))
        start, values = ' '.join(texts[0][:count]), ', '.join(filter(None, cells[0][1:3]))
        names = [f'- {row[0]}: {" ".join(words[count:])}' for row, words in zip(cells, texts, strict=True)]
        return '\n'.join([f'{start} ..., default {values}:\n', *names])
    are_all_live = {row[2] for row in cells} == {'live'}
    lines = ['All are live.\n'] if are_all_live else []
    for name, values, live, text in cells:
        parts = values.removeprefix('*none*').removeprefix(', '), '' if are_all_live else live
        notes = ', '.join(filter(None, parts))
        lines.append(f'- {name} ({notes}): {text}' if notes else f'- {name}: {text}')
    return '\n'.join(lines)


def _group_of(row: Parameter) -> str:
    return row.name.rpartition('.')[0]


def render_page() -> str:
    """Return the whole page."""
    parts = [INTRO, '## The node\n', _format_list(NODE_PARAMETERS)]
    parts.append('\n## A bearing\n\nIn the section of that name.')
    shared = [row for rows in _shared_rows() for row in rows]
    for group, title, text in GROUPS:
        parts.append(f'\n### {title}\n')
        if text:
            parts.append(f'{text}\n')
        inputs = ('speed', 'load') if group == INPUT else (group,)
        rows = [row for row in BEARING_PARAMETERS if _group_of(row) in inputs and row not in shared]
        parts.append(_format_list([*_input_rows(), *rows] if group == INPUT else rows))
    return '\n'.join(parts) + '\n'


def render_life() -> str:
    """Return the states and transitions of an alarm, a line for each state or set of states."""
    becomes: dict[str, list[str]] = {}
    for row in LIFE.splitlines():
        states, trigger, choices = row.split(' | ')
        names = f'`{states}` ({AlarmState(states).letter})' if states in {*AlarmState} else states
        becomes.setdefault(names, []).append(f'*{trigger}*: {choices}')
    lines = [
        '',
        'The states, with their letters in ISA-18.2, and what each becomes; anything else changes nothing.',
        '*Covered*: a worse alarm stands for it. *Latching*: it latches and has been active. *Recur*:'
        ' stick-slip began again while its alarm was active.',
        '',
        *(f'- {names}: {"; ".join(rows)}.' for names, rows in becomes.items()),
        '',
    ]
    return '\n'.join(lines) + '\n'


def with_life(page: str) -> str:
    """Return the page on alarms with its lists made anew."""
    return LIFECYCLE.sub(lambda _: render_life(), page, count=1)


def with_links(page: str) -> str:
    """Return the page on the ship's buses with its lists made anew."""
    lists = f'\n{_format_list(LINK_PARAMETERS)}\n\n{_format_list(INPUT_PARAMETERS)}\n\n'
    return LINKS.sub(lambda _: lists, page, count=1)


def with_diagnostics(page: str) -> str:
    """Return the page on interfaces with the list of a bearing's diagnostic keys made anew."""
    lines = []
    for needs, condition in NEEDED.items():
        keys = ', '.join(_diagnostic_key(row) for row in BEARING if row.key and row.needs == needs)
        lines.append(f'- {condition}: {keys}.')
    return DIAGNOSTICS.sub(lambda _: '\n' + '\n'.join(lines) + '\n\n', page, count=1)


def _diagnostic_key(row: RecordField) -> str:
    """Return a key, with its field in brackets where its words are not those of the field."""
    words = row.key.partition(' [')[0].replace(' ', '_')
    return f'`{row.key}`' if words == row.name else f'`{row.key}` (`{row.name}`)'


def measure_rooms() -> dict[str, tuple[int, int]]:
    """Return modules and lines of each room; what stands beside the rooms of a package bears its name."""
    sizes: dict[str, tuple[int, int]] = {}
    for path in sorted(path for package in PACKAGES for path in (ROOT / package).rglob('*.py')):
        inside = path.relative_to(ROOT).parts
        room = '/'.join(inside[:2]) if len(inside) > 2 else inside[0]
        modules, lines = sizes.get(room, (0, 0))
        sizes[room] = modules + 1, lines + len(path.read_text('utf-8').splitlines())
    return sizes


def is_undecided(row: tuple[int, int], now: tuple[int, int]) -> bool:
    """Return whether a room has a module or 3 % of lines more than its row, or 5 % less than it."""
    return now[0] > row[0] or not 0.95 * row[1] <= now[1] <= 1.03 * row[1]


def decided_sizes(page: str) -> dict[str, tuple[int, int]]:
    """Return modules and lines of each room, as the page on design has them."""
    return {room: (int(modules), int(lines.replace(',', ''))) for room, modules, lines in SIZE.findall(page)}


def with_rooms(page: str) -> str:
    """Return the page on design with the rows of rooms brought up to date."""
    now, rows = measure_rooms(), decided_sizes(page)

    def row(match: re.Match[str]) -> str:
        room = match[1]
        if room not in now or not is_undecided(rows[room], now[room]):
            return match[0]
        return f'| `{room}` | {now[room][0]} | {now[room][1]:,} |'

    return SIZE.sub(row, page)


def run_tutorial(page: str, folder: Path) -> str:
    """Run the tutorial's blocks in a folder beside the recordings; return it with what they print."""
    os.environ.setdefault('MPLBACKEND', 'Agg')
    for name in ('bags', 'launch_configs'):
        (folder / name).symlink_to(ROOT / name)
    names: dict[str, Any] = {}

    def run(block: re.Match[str]) -> str:
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(block['code'], TUTORIAL.name, 'exec'), names)
        output = f'\n```text\n{printed.getvalue()}```\n' if printed.getvalue() else ''
        return f'```python\n{block["code"]}```\n{output}'

    previous = Path.cwd()
    os.chdir(folder)
    try:
        return CELL.sub(run, page)
    finally:
        os.chdir(previous)
        names['plt'].close()


SCHEMAS: dict[str, tuple[tuple[RecordField, ...], tuple[str, ...]]] = {
    'warning-3': (WARNING, ('properties',)),
    'assessment-2': (ASSESSMENT, ('properties',)),
    'bearings-4': (BEARING, ('properties', 'bearings', 'items', 'properties')),
}
"""Of each schema that is made of the fields these, and where their properties stand in it."""


def with_schema(text: str, fields: tuple[RecordField, ...], place: tuple[str, ...]) -> str:
    """Return the text of a schema with some fields; what it has beside them stays."""
    at = place[:-1]
    document = json.loads(text)
    node = document
    for name in at:
        node = node[name]
    schema = schema_of(fields, () if at else ('measured',))
    old = node['properties']
    more = {name: value for name, value in old.items() if name not in schema['properties']}
    head = {name: more.pop(name) for name in ('schema',) if name in more}
    node['required'] = [*head, *schema['required'], *more]
    node['properties'] = head | schema['properties'] | more
    return _indent_json(document) + '\n'


def _indent_json(value: Any, depth: int = 0) -> str:
    """Return JSON with a line for each property that has objects, and one for each that has none."""
    is_deep = isinstance(value, dict) and (
        not depth or any(isinstance(item, dict) for item in value.values())
    )
    if not is_deep:
        return json.dumps(value, ensure_ascii=False)
    pad = ' ' * (depth + 1)
    rows = [f'{pad}{json.dumps(name)}: {_indent_json(item, depth + 1)}' for name, item in value.items()]
    return '{\n' + ',\n'.join(rows) + '\n' + ' ' * depth + '}'


def main() -> int:
    """Write the page, the generated parts of the others, and the schemas."""
    for name, (fields, place) in SCHEMAS.items():
        path = ROOT / 'stickslip_monitor' / 'schemas' / f'{name}.json'
        path.write_text(with_schema(path.read_text('utf-8'), fields, place), 'utf-8')
    DESIGN.write_text(with_rooms(DESIGN.read_text(encoding='utf-8')), encoding='utf-8')
    with tempfile.TemporaryDirectory() as folder:
        TUTORIAL.write_text(run_tutorial(TUTORIAL.read_text('utf-8'), Path(folder)), 'utf-8')
        shutil.copy(Path(folder, PICTURE.name), PICTURE)
    SHIP.write_text(with_links(SHIP.read_text(encoding='utf-8')), encoding='utf-8')
    INTERFACES.write_text(with_diagnostics(INTERFACES.read_text('utf-8')), 'utf-8')
    PAGE.write_text(render_page(), encoding='utf-8')
    RULE.write_text(with_life(RULE.read_text(encoding='utf-8')), encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
