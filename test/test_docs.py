# SPDX-License-Identifier: Apache-2.0
"""The docs say what the program does: generated pages are fresh, examples are valid."""

from __future__ import annotations

import ast
import re
from dataclasses import replace
from pathlib import Path

import make_docs
import pytest
from shared import ROOT, png_size

import stickslip_monitor
from stickslip_monitor import Bearing, Stribeck, Tabulated, assess
from stickslip_monitor.drawing.canvas import CONDITION_NAMES
from stickslip_monitor.monitor.alarm_states import TABLE, AlarmKind, AlarmState
from stickslip_monitor.monitor.input_faults import InputFacts, Publisher, SourceFaultKind, input_fault
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.monitor.parameters import BEARING_PARAMETERS, INPUT_PARAMETERS, NODE_PARAMETERS
from stickslip_monitor.monitor.sample_types import STATUS_SENTENCES
from stickslip_monitor.monitor.severity import Condition

DOCS = ROOT / 'docs'
PAGE = DOCS / 'configuration.md'
API = DOCS / 'api.md'
MAX_WORDS = 21_000
"""Words of all pages together, which somebody reads in a working day: say a fact once, and link to it."""


def _check_fresh(page: Path, generated: str, command: str) -> None:
    fresh = page.is_file() and page.read_text(encoding='utf-8') == generated
    assert fresh, f'{page.name} is stale: run `{command}`'


def test_reference_page_and_the_parameters_of_the_links_are_fresh() -> None:
    _check_fresh(PAGE, make_docs.render_page(), make_docs.COMMAND)
    page = make_docs.SHIP.read_text(encoding='utf-8')
    _check_fresh(make_docs.SHIP, make_docs.with_links(page), make_docs.COMMAND)
    assert '\n- `signalk.url`: ' in page


def test_the_diagnostic_keys_are_fresh_and_whole() -> None:
    page = make_docs.INTERFACES.read_text(encoding='utf-8')
    _check_fresh(make_docs.INTERFACES, make_docs.with_diagnostics(page), make_docs.COMMAND)
    missing = [row.key for row in make_docs.BEARING if row.key and f' `{row.key}`' not in page]
    assert missing == []


def test_the_life_of_an_alarm_is_fresh() -> None:
    page = make_docs.RULE.read_text(encoding='utf-8')
    _check_fresh(make_docs.RULE, make_docs.with_life(page), make_docs.COMMAND)
    lines = re.findall(r'^- ([^:]*): (\*\w+\*: .*)\.$', page, flags=re.MULTILINE)
    rows = [(states, *row.split(': ')) for states, line in lines for row in line.split('; ')]
    for (state, trigger), choices in TABLE.items():
        (becomes,) = [
            row[2] for row in rows if state in re.findall(r'\w+', row[0]) and row[1] == f'*{trigger}*'
        ]
        assert re.findall(rf'\b({"|".join(AlarmState)})\b', becomes.replace('if suppressed', '')) == [
            target for _, target in choices
        ]


def test_every_parameter_has_one_row() -> None:
    rows = re.findall(r'^- `([a-z_.<>]+)`(?: \(.*\))?: ', make_docs.render_page(), flags=re.MULTILINE)
    sections = [
        row.replace('<input>', name)
        for row in rows
        for name in (INPUT_PARAMETERS if row.startswith('<') else ('',))
    ]
    assert sorted(sections) == sorted(p.name for p in (*NODE_PARAMETERS, *BEARING_PARAMETERS))


def test_the_example_is_a_configuration(tmp_path: Path) -> None:
    (example,) = re.findall(r'^```yaml\n(.*?)^```', make_docs.INTRO, flags=re.DOTALL | re.MULTILINE)
    path = tmp_path / 'example.yaml'
    path.write_text(example, encoding='utf-8')
    config = load_config(path)
    aft, forward = config.bearings
    assert (aft.name, forward.name) == ('aft_stern', 'forward_stern')
    assert isinstance(aft.bearing.friction, Stribeck)
    assert isinstance(forward.bearing.friction, Tabulated)
    assert forward.load.field == ('wrench', 'force', 'z')
    assert (forward.load.scale, forward.load.offset) == (-1.0, 120.0)


def test_the_docs_stay_short_enough_to_be_read() -> None:
    assert sum(len(page.read_text('utf-8').split()) for page in DOCS.rglob('*.md')) <= MAX_WORDS


def _read_anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as both GitHub and mkdocs make them."""
    text = re.sub(r'^```.*?^```', '', page.read_text('utf-8'), flags=re.DOTALL | re.MULTILINE)
    headings = re.findall(r'^#+ (.+)$', text, flags=re.MULTILINE)
    plain = (re.sub(r'\[([^]]*)\]\([^)]*\)', r'\1', heading).strip().lower() for heading in headings)
    return {re.sub(r'[^\w\- ]', '', heading).replace(' ', '-') for heading in plain}


def test_links_lead_somewhere() -> None:
    dead = []
    for page in (*ROOT.glob('*.md'), *DOCS.glob('*.md')):
        for target, anchor in re.findall(r'\]\(([^)#]*)(?:#([^)]*))?\)', page.read_text(encoding='utf-8')):
            if '://' in target:
                continue
            path = page.parent / target if target else page
            if not path.exists() or (anchor and anchor not in _read_anchors(path)):
                dead.append((page.name, target, anchor))
    assert dead == []


def test_pages_that_the_program_names_are_there() -> None:
    """Look up the pages in messages, helps and docstrings, perhaps with an anchor or a section."""
    dead, section_count = [], 0
    sources = [path for package in ROOT.glob('stickslip_*') for path in package.rglob('*.py')]
    for source in sources:
        text = re.sub(r"'\n\s*[rf]?'", '', source.read_text('utf-8'))
        for name, anchor, section in re.findall(
            r'\b([a-z][a-z_]*\.md)(?:#([\w-]+)|, section (\d+)|, "[^"]*")?', text
        ):
            page = DOCS / name if (DOCS / name).exists() else ROOT / name
            anchors = _read_anchors(page) if page.exists() else set()
            headings = [a for a in anchors if a == anchor or (section and a.startswith(f'{section}-'))]
            section_count += bool(section)
            if not page.exists() or ((anchor or section) and not headings):
                dead.append((source.name, name, anchor or section))
    assert dead == []
    assert section_count >= 2


def test_the_examples_of_python_run(capsys: pytest.CaptureFixture[str]) -> None:
    examples = re.findall(r'^```python\n(.*?)^```', API.read_text('utf-8'), re.DOTALL | re.M)
    assert examples
    for example in examples:
        exec(compile(example, API.name, 'exec'), {})
    # The reference bearing from 5 to 45 rpm: unstable below 30.7 rpm, bistable up to 40.7 rpm.
    regimes = re.findall(r'unstable|bistable|stable', capsys.readouterr().out)
    assert regimes == ['unstable'] * 6 + ['bistable'] * 2 + ['stable']


def test_the_configuration_of_the_readme_is_one(tmp_path: Path) -> None:
    (example,) = re.findall(r'^```yaml\n(.*?)^```', (ROOT / 'README.md').read_text('utf-8'), re.DOTALL | re.M)
    (tmp_path / 'my_ship.yaml').write_text(example, 'utf-8')
    (bearing,) = load_config(tmp_path / 'my_ship.yaml').bearings
    assert bearing.load.field == ('wrench', 'force', 'z')


def test_public_names_are_documented() -> None:
    page = API.read_text(encoding='utf-8')
    assert [n for n in stickslip_monitor.__all__ if not re.search(rf'\b{n}\b', page)] == []


def test_people_read_one_name_for_one_thing() -> None:
    page = (DOCS / 'glossary.md').read_text('utf-8').partition('## One word for one thing')[2]
    cell = r'\s*(?:`(\w+)`)?[^|]*\|'
    rows = re.findall(rf'^\| ([A-Z][^|]*) \|{cell}{cell}', page, flags=re.MULTILINE)
    conditions = {condition: name for name, condition, _ in rows if condition}
    alarms = {alarm: name for name, _, alarm in rows if alarm}
    assert alarms.keys() == set(AlarmKind)
    assert {key: name for key, name in conditions.items() if key in set(Condition)} == CONDITION_NAMES
    scripts = ROOT / 'stickslip_monitor' / 'dashboard' / 'page'
    badges = re.search(r'REASONS = {(.*?)}', (scripts / 'page.js').read_text('utf-8'))
    listed = re.search(r'NAMES = {(.*?)}', (scripts / 'alarms.js').read_text('utf-8'), re.DOTALL)
    # A badge begins with a sign.
    assert dict(re.findall(r"(\w+): '\S+ (.*?)'", badges[1])) == conditions
    assert dict(re.findall(r"(\w+): '(.*?)'", listed[1])) == alarms


def test_the_readme_says_how_far_averaging_can_be_off() -> None:
    """Compare with the exact cycle, which 40-digit references hold to 1e-6."""
    text = ' '.join((ROOT / 'README.md').read_text('utf-8').split())
    bearing = load_config(ROOT / 'launch_configs' / 'reference_bearing.yaml').bearings[0].bearing
    (far, near) = re.findall(r'([\d.]+) \((\d+) rpm\)', text)
    for factor, rpm in (far, near):
        point = assess(bearing, float(bearing.speed.to_surface(float(rpm), 'rpm')), 10_000.0)
        assert f'{point.amplitude_exact / point.amplitude:.1f}' == factor
    fold = assess(bearing, 0.1, 1000.0).fold_speed
    for percent, part in re.findall(r'by (\d+) % at (half|a quarter)', text):
        point = assess(bearing, fold * {'half': 0.5, 'a quarter': 0.25}[part], 1000.0)
        assert f'{-100.0 * point.amplitude_error:.0f}' == percent


def test_the_first_alarm_says_what_each_value_moves() -> None:
    # The table is in whole per cent, but for a half, of the reference bearing at 1 kN.
    bearing = load_config(ROOT / 'launch_configs' / 'reference_bearing.yaml').bearings[0].bearing
    law = bearing.friction
    changed = {
        'damping': (replace(bearing, damping=1.1 * bearing.damping), 1000.0),
        'load': (bearing, 1100.0),
        'fall of friction, `static - kinetic`': (
            replace(bearing, friction=replace(law, static=0.32)),
            1000.0,
        ),
        'decay `beta`': (replace(bearing, friction=replace(law, decay=1.1 * law.decay)), 1000.0),
        'mass': (replace(bearing, mass=1.1 * bearing.mass), 1000.0),
        'stiffness': (replace(bearing, stiffness=1.1 * bearing.stiffness), 1000.0),
    }
    speed = float(bearing.speed.to_surface(20.0, 'rpm'))

    def figures(case: tuple[Bearing, float]) -> list[float]:
        point = assess(case[0], speed, case[1])
        return [point.hopf_speed, point.fold_speed, point.amplitude_exact]

    page = (DOCS / 'first_alarm.md').read_text('utf-8')
    rows = re.findall(
        r'^\| ([^|]+) \| ([-+.\d]+)[ %]*\| ([-+.\d]+)[ %]*\| ([-+.\d]+)[ %]*\|$', page, re.MULTILINE
    )
    assert {row[0] for row in rows} == set(changed)
    for name, *shown in rows:
        moved = [
            100 * (new / old - 1)
            for new, old in zip(figures(changed[name]), figures((bearing, 1000.0)), strict=True)
        ]
        assert [float(text) for text in shown] == pytest.approx(moved, abs=0.5)


# What stands for something else in a sentence of the page: names, types, numbers, the rest.
_STANDS_FOR = re.compile(r"/[a-z]\b|\bN messages|\b[TUN]\b|\d+(?:\.\d+)?|\.\.\.|[\[:']")


def read_troubles() -> list[list[str]]:
    """Return the fixed parts of each sentence of the troubleshooting page, in order."""
    page = (DOCS / 'troubleshooting.md').read_text('utf-8')
    sentences, start = [], ''
    for indent, text in re.findall(r'^( *)- \*(.*?)\*:?(?: |$)', page, re.MULTILINE):
        start = start if indent else text.removesuffix('...')
        sentences.append(start + text if indent else text)
    assert len(sentences) > 40
    return [[part.strip() for part in _STANDS_FOR.split(text) if part.strip()] for text in sentences]


def texts_of_program() -> list[str]:
    """Return every text of the program, with a zero where it fills something in."""
    texts = []
    for path in (*(ROOT / 'stickslip_monitor').rglob('*.py'), ROOT / 'launch_configs' / 'monitor.launch.py'):
        for node in ast.walk(ast.parse(path.read_text('utf-8'))):
            if isinstance(node, ast.JoinedStr):
                parts = (p.value if isinstance(p, ast.Constant) else '0' for p in node.values)
                texts.append(''.join(map(str, parts)))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                texts.append(node.value)
    return texts


def test_every_sentence_on_troubles_is_one_of_the_program() -> None:
    texts = [*texts_of_program(), *input_fault_sentences()]
    # A sentence may be put together from several; its longer parts are somewhere.
    known_names = [
        any(part in text for part in parts if len(part) >= 15 for text in texts)
        or any(all(part in text for part in parts) for text in texts)
        for parts in read_troubles()
    ]
    assert [parts for parts, is_known in zip(read_troubles(), known_names, strict=True) if not is_known] == []


def input_fault_sentences() -> list[str]:
    """Return every sentence on an input that brings nothing, or whose values are doubtful."""
    first, second = Publisher('/a', 'T'), Publisher('/b', 'T')
    facts = InputFacts('/x', 'T', True, (first,))
    constants = [
        replace(facts, without_clock=True),
        replace(facts, publishers=()),
        replace(facts, publishers=(), gone='/n'),
        replace(facts, undecodable=True),
        replace(facts, publishers=(replace(first, latched=True),)),
        replace(facts, publishers=(Publisher('/a', 'U'),)),
        replace(facts, publishers=(Publisher('/a', 'T', 'DEADLINE'),)),
        facts,
        *(replace(facts, refused=s) for s in STATUS_SENTENCES),
        replace(facts, lost=False, receiving=True, behind=10.0),
        replace(facts, lost=False, publishers=(first, second)),
        *(replace(facts, lost=False, source=kind.sentence) for kind in SourceFaultKind),
    ]
    return [input_fault(value) for value in constants]


@pytest.mark.parametrize('sentence', input_fault_sentences())
def test_every_fault_of_an_input_is_on_the_page(sentence: str) -> None:
    assert sentence
    assert any(re.search('.*'.join(map(re.escape, parts)), sentence) for parts in read_troubles())


def _defined_names(path: Path) -> set[str]:
    """Return the functions and classes of a module, and what a class has, with a dot."""
    names = set()
    for node in ast.parse(path.read_text('utf-8')).body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            names.add(node.name)
        if isinstance(node, ast.ClassDef):
            for item in node.body:
                if isinstance(item, ast.FunctionDef):
                    names.add(f'{node.name}.{item.name}')
                elif isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name):
                    names.add(f'{node.name}.{item.target.id}')
    return names


def test_the_walks_lead_through_the_house() -> None:
    page = (DOCS / 'design.md').read_text('utf-8')
    walks = page.partition('## Three walks')[2].partition('\n## ')[0]
    steps = re.findall(r'^\d+\. `([\w/]+\.py)`, `([\w.]+)`: ', walks, re.MULTILINE)
    assert len(steps) > 20
    package = ROOT / 'stickslip_monitor'
    assert [
        s
        for s in steps
        if s[1] not in _defined_names(ROOT / s[0] if s[0].startswith('stickslip_') else package / s[0])
    ] == []
    # What else the page names is there.
    named = re.findall(r'`((?:[a-z_]+/)+[\w.]*|live\.py)`', page)
    assert [n for n in named if not any((base / n).exists() for base in (package, ROOT))] == []


@pytest.mark.parametrize('name', ['rule.md', 'design.md'])
def test_the_constants_that_a_page_names_are_set(name: str) -> None:
    constant = r'_?[A-Z]{2,}(?:_[A-Z]+)*'
    named = set(re.findall(f'`({constant})`', (DOCS / name).read_text('utf-8')))
    sources = [
        path.read_text('utf-8') for package in ROOT.glob('stickslip_*') for path in package.rglob('*.py')
    ]
    heads = [line.partition(' = ')[0] for text in sources for line in text.splitlines() if ' = ' in line]
    assert sorted(named - set(re.findall(rf'\b{constant}\b', '\n'.join(heads)))) == []


def test_the_plan_of_the_house_has_every_room() -> None:
    plan = (DOCS / 'design.md').read_text('utf-8').partition('## How large it is')[0]
    rows = re.findall(r'^\| `(stickslip_\w+/\w+)` \|.*\| `([\w/.]+)` \|$', plan, re.MULTILINE)
    assert {room for room, _ in rows} == {room for room in make_docs.measure_rooms() if '/' in room}
    assert [start for _, start in rows if not (ROOT / start).is_file()] == []


def test_no_room_grows_without_a_decision() -> None:
    rows, now = make_docs.decided_sizes((DOCS / 'design.md').read_text('utf-8')), make_docs.measure_rooms()
    assert rows.keys() == now.keys()
    off = {room: (rows[room], now[room]) for room in rows if make_docs.is_undecided(rows[room], now[room])}
    assert off == {}, 'make it smaller, or decide its size: `make docs`, and say why in the commit'


@pytest.mark.parametrize(
    ('now', 'undecided'),
    [((3, 1030), False), ((3, 1031), True), ((4, 1000), True), ((2, 950), False), ((2, 949), True)],
)
def test_sizes_of_a_room_that_need_a_decision(now: tuple[int, int], undecided: bool) -> None:
    row = make_docs.decided_sizes('| `a` | 3 | 1,000 |\n')['a']
    assert make_docs.is_undecided(row, now) is undecided


def test_the_tutorial_prints_what_it_shows(tmp_path: Path) -> None:
    page = make_docs.TUTORIAL.read_text('utf-8')
    assert make_docs.run_tutorial(page, tmp_path) == page, f'run `{make_docs.COMMAND}`'
    assert page.count('```text') == 3
    assert png_size(tmp_path / make_docs.PICTURE.name) == png_size(make_docs.PICTURE)
