# SPDX-License-Identifier: Apache-2.0
"""The docs say what the program does: generated pages are fresh, examples are valid."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

import stickslip_monitor
from stickslip_monitor import Stribeck, Tabulated
from stickslip_monitor.monitor.alarms.lifecycle import TABLE, AlarmState
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.monitor.table import BEARING_PARAMETERS, NODE_PARAMETERS

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / 'docs'
PAGE = DOCS / 'configuration.md'
API = DOCS / 'api.md'


@pytest.fixture(scope='module')
def make_docs() -> ModuleType:
    spec = importlib.util.spec_from_file_location('make_docs', ROOT / 'scripts' / 'make_docs.py')
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def _check_fresh(page: Path, made: str, command: str) -> None:
    fresh = page.is_file() and page.read_text(encoding='utf-8') == made
    assert fresh, f'{page.name} is stale: run `{command}`'


def test_reference_page_is_fresh(make_docs: ModuleType) -> None:
    _check_fresh(PAGE, make_docs.render(), make_docs.COMMAND)


def test_the_life_of_an_alarm_is_fresh(make_docs: ModuleType) -> None:
    page = make_docs.ALARMS.read_text(encoding='utf-8')
    _check_fresh(make_docs.ALARMS, make_docs.with_life(page), make_docs.COMMAND)
    row = 'acknowledged | clear | latched if it latches and its cause has been there, else normal'
    assert f'| {row} |' in page.splitlines()
    for (state, trigger), choices in TABLE.items():
        (line,) = re.findall(rf'^\| {state} \| {trigger} \| (.*) \|$', page, flags=re.MULTILINE)
        assert re.findall(rf'\b({"|".join(AlarmState)})\b', line) == [
            target for _, target in choices
        ]


def test_the_parameters_of_the_links_are_fresh(make_docs: ModuleType) -> None:
    page = make_docs.SHIP.read_text(encoding='utf-8')
    _check_fresh(make_docs.SHIP, make_docs.with_links(page), make_docs.COMMAND)
    assert '| `signalk.url` |' in page


def test_a_stale_page_is_noticed(make_docs: ModuleType, tmp_path: Path) -> None:
    page = tmp_path / 'configuration.md'
    for content in (None, make_docs.render().replace('| `mass` |', '| `weight` |')):
        if content is not None:
            page.write_text(content, encoding='utf-8')
        with pytest.raises(AssertionError, match=r'is stale: run `python scripts/make_docs\.py`'):
            _check_fresh(page, make_docs.render(), make_docs.COMMAND)


def test_every_parameter_has_one_row(make_docs: ModuleType) -> None:
    rows = re.findall(r'^\| `([a-z_.]+)` \|', make_docs.render(), flags=re.MULTILINE)
    assert sorted(rows) == sorted(p.name for p in (*NODE_PARAMETERS, *BEARING_PARAMETERS))


def test_every_row_has_seven_cells(make_docs: ModuleType) -> None:
    rows = [line for line in make_docs.render().splitlines() if line.startswith('|')]
    assert {len(re.findall(r'(?<!\\)\|', row)) for row in rows} == {8}


@pytest.mark.parametrize(
    'row',
    [
        '| `mass` | number | *required* | > 0 | kg | | Moving mass of the lining. |',
        '| `damping` | number | *required* | ≥ 0 | N s/m | | Damping of the lining. |',
        '| `friction.decay` | number | *by law* | > 0 | s/m | | Decay beta of the Stribeck law'
        ' with speed. |',
        '| `load.maximum` | number | `1e8` | > 0 | N | live | Largest magnitude believed; a larger'
        ' value is counted as implausible and not used. |',
        '| `load.scale` | number | `1` | | | live | Factor applied to the number. |',
        '| `load.unit` | text | *required* | `N`, `kN` | | | Unit of scale * number + offset. |',
        '| `autostart` | true/false | `true` | | | | Configure and activate the node by itself'
        ' when it starts. |',
    ],
)
def test_rows_say_what_the_table_says(make_docs: ModuleType, row: str) -> None:
    assert row in make_docs.render().splitlines()


def test_the_example_is_a_configuration(make_docs: ModuleType, tmp_path: Path) -> None:
    (example,) = re.findall(
        r'^```yaml\n(.*?)^```', make_docs.INTRO, flags=re.DOTALL | re.MULTILINE
    )
    path = tmp_path / 'example.yaml'
    path.write_text(example, encoding='utf-8')
    config = load_config(path)
    aft, forward = config.bearings
    assert (aft.name, forward.name) == ('aft_stern', 'forward_stern')
    assert isinstance(aft.bearing.friction, Stribeck)
    assert isinstance(forward.bearing.friction, Tabulated)
    assert forward.load.field == ('wrench', 'force', 'z')
    assert (forward.load.scale, forward.load.offset) == (-1.0, 120.0)


def test_links_lead_somewhere() -> None:
    for page in sorted(DOCS.glob('*.md')):
        for target in re.findall(r'\]\(([^)#]+)(?:#[^)]*)?\)', page.read_text(encoding='utf-8')):
            if '://' not in target:
                assert (DOCS / target).exists(), f'{page.name} links to {target}'


@pytest.mark.skipif(not API.exists(), reason='docs/api.md is not written yet')
@pytest.mark.parametrize('name', stickslip_monitor.__all__)
def test_public_names_are_documented(name: str) -> None:
    assert re.search(rf'\b{name}\b', API.read_text(encoding='utf-8')), f'{name} is not in api.md'


def test_public_names_are_sorted_and_exist() -> None:
    assert stickslip_monitor.__all__ == sorted(stickslip_monitor.__all__)
    for name in stickslip_monitor.__all__:
        assert hasattr(stickslip_monitor, name)
