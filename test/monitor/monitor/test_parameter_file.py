# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from sending import configured
from shared import ROOT

from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.monitor.parameter_file import load_config, load_parameters, load_yaml

AFT = """\
    bearings: [aft]
    aft:
      mass: 50
      damping: 400.0
      stiffness: 2.0e6
      journal_diameter: 0.1
      friction: {static: 0.3, kinetic: 0.1, decay: 10.0}
      speed: {topic: /shaft/speed, unit: rpm}
      load: {topic: /bearing/aft/load, unit: N}
"""
WHOLE = '/**:\n  ros__parameters:\n' + AFT
OTHERS = ('/stickslip', '/stickslip_monitor_2', '/stickslip_monitor/x')
TEXTS = (('2_000', '2_000'), ('"2000"', '2000'), ('"2000,0"', '2000,0'))
Write = Callable[[str | bytes], Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def to_file(content: str | bytes) -> Path:
        path = tmp_path / 'monitor.yaml'
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return to_file


def refusal_of(path: Path) -> str:
    with pytest.raises(ConfigurationError) as caught:
        load_config(path)
    text = str(caught.value)
    assert text.startswith(str(path))
    assert '\n' not in text
    return text.removeprefix(str(path))


def test_a_file_equals_the_same_values(write: Write) -> None:
    assert load_config(write(WHOLE)) == configured()
    assert load_config(str(write(WHOLE))) == configured()


@pytest.mark.parametrize(
    'section', ['/**', '/*', 'stickslip_monitor', '/stickslip_monitor', '/ns/stickslip_monitor']
)
def test_sections_that_apply(write: Write, section: str) -> None:
    text = f'other_node:\n  ros__parameters: {{mass: 1}}\n{section}:\n  ros__parameters:\n{AFT}'
    assert load_config(write(text)).bearings[0].name == 'aft'


def test_later_sections_override_single_values(write: Write) -> None:
    section = 'stickslip_monitor:\n  ros__parameters: {aft: {mass: 7.0, friction: {decay: 5.0}}}\n'
    config = load_config(write(WHOLE + section)).bearing('aft').bearing
    assert (config.mass, config.damping) == (7.0, 400.0)
    assert config.friction.coefficient(0.2) == pytest.approx(0.1 + 0.2 * 2.718281828459045**-1)
    overridden = load_config(write(section + WHOLE)).bearing('aft').bearing
    assert overridden.mass == 50.0


def test_dotted_names_and_nested_names_are_the_same(write: Write) -> None:
    dotted = WHOLE.replace('      mass: 50\n', '').replace('    bearings', '    aft.mass: 50.0\n    bearings')
    assert load_config(write(dotted)) == load_config(write(WHOLE))


@pytest.mark.parametrize(
    ('text', 'value'),
    [
        ('2.0e6', 2e6),
        ('1e-3', 1e-3),
        ('-1e-3', -1e-3),
        ('2.e6', 2e6),
        ('3', 3),
        ('.inf', float('inf')),
        ('1e3x', '1e3x'),
        ('N', 'N'),
        ('"1e3"', '1e3'),
        # Of these rclpy 9.1 made just these values of a parameter file.
        ('0x10', 16),
        ('010', 8),
        ('08', 8.0),
        ('1:30', '1:30'),
        ('2_000', '2_000'),
        ('2026-11-26', '2026-11-26'),
        ('Infinity', float('inf')),
        ('y', True),
        ('off', False),
    ],
)
def test_spellings_of_a_number(write: Write, text: str, value: Any) -> None:
    read = load_yaml(write(f'a: {text}\n'))['a']
    assert read == value
    assert type(read) is type(value)


NO_FILE = " must be a ROS 2 parameter file: '/**:' with 'ros__parameters:' inside"
IN_NODE = '/**:\n  ros__parameters:\n    '
NONE = "has no parameters for 'stickslip_monitor': its sections are"
RANGE = 'must be a finite number between 1e-06 and 1e+07 kg'


@pytest.mark.parametrize(
    ('content', 'text'),
    [
        ('', NO_FILE),
        ('- a\n- b\n', NO_FILE),
        ('/**:\n  bearings: [aft]\n', ": section '/**' must hold 'ros__parameters:'"),
        ('/**:\n  ros__parameters:\n', ", line 2: key 'ros__parameters' has no value"),
        ('/**:\n\tros__parameters: {}\n', ", line 2: found character '\\t' that cannot start any"),
        ('a: 1\n---\nb: 2\n', ', line 2: but found another document'),
        ('a: !!python/object:os.system x\n', ', line 1: could not determine a constructor for'),
        ('? [a, b]\n: c\n', ', line 1: found unhashable key'),
        ('a: &x 1\nb: *x\n', ", line 2: alias '*x' must be written out: ROS 2 reads no aliases"),
        ('[' * 400, ' is nested too deeply'),
        ('a: \0\n', ' is not YAML: unacceptable character #x0000'),
        (b'a: \xff\xfe\x00\n', ' is not a text file: '),
        (WHOLE + '      mass: 60\n', ", line 12: key 'mass' is given twice"),
        (WHOLE + WHOLE, ", line 12: key '/**' is given twice"),
        ('a: {b: 1, c: 2,\n  b: 3}\n', ", line 2: key 'b' is given twice"),
        ('1: a\n1: b\n', ", line 2: key '1' is given twice"),
        (WHOLE + '    aft.mass: 60.0\n', ": 'aft.mass' is given twice, with dots and in a section: keep one"),
        (WHOLE.replace('mass: 50', 'mass: -1'), f': aft.mass = -1 {RANGE}'),
        *((f'{name}:\n  ros__parameters:\n{AFT}', f" {NONE} {name}; use '/**'") for name in OTHERS),
        # A bearing called n is a switch for no reader.
        (WHOLE.replace('[aft]', '[n]').replace(' aft:', ' n:'), ': bearings = [False] must be a list of'),
        # rcl: "No value at line" and "Sequence should be of same type", seen with rclpy 9.1.
        (
            IN_NODE + 'friction: {static: 0,30}',
            ", line 3: key '30' has no value: in braces a comma separates",
        ),
        (IN_NODE + 'scalle:', ", line 3: key 'scalle' has no value"),
        (
            IN_NODE + 'speed: [0, .02, .05]',
            ', line 3: a list mixes float and int, which ROS 2 refuses: write 0.0',
        ),
        (IN_NODE + 'names: [a, 1]', ', line 3: a list mixes int and str, which ROS 2 refuses'),
        # A number that was read as a text.
        *(
            (WHOLE.replace('50', number_text), f': aft.mass = {read!r} {RANGE}: write 2000')
            for number_text, read in TEXTS
        ),
    ],
)
def test_refused_files(write: Write, content: str | bytes, text: str) -> None:
    assert refusal_of(write(content)).startswith(text)


def test_no_file_and_a_folder(tmp_path: Path) -> None:
    assert refusal_of(tmp_path) == ': it is a folder, not a file'
    assert refusal_of(tmp_path / 'none.yaml') == ': No such file or directory'


def test_parameters_of_ros_itself_are_left_alone(write: Write) -> None:
    node_settings = (
        '    use_sim_time: true\n'
        '    start_type_description_service: false\n'
        '    qos_overrides: {/parameter_events: {publisher: {depth: 7}}}\n'
    )
    assert load_config(write(WHOLE + node_settings)) == load_config(write(WHOLE))


def test_a_pattern_for_others_asks_nothing(write: Write) -> None:
    own_section = WHOLE.replace('/**:', '/stickslip_monitor:')
    foreign_section = '/camera/**: {ros__parameters: {rate: 5}}\n'
    assert load_config(write(own_section + foreign_section)) == load_config(write(WHOLE))


OF_TWO = """
/**: {ros__parameters: {bearings: [aft]}}
/port/stickslip_monitor: {ros__parameters: {aft: {mass: 50.0}}}
starboard: {stickslip_monitor: {ros__parameters: {aft: {mass: 90.0}}}}
/port/camera: {ros__parameters: {rate: 5}}
"""


@pytest.mark.parametrize(
    ('node', 'mass'), [('/port/stickslip_monitor', 50.0), ('starboard/stickslip_monitor', 90.0)]
)
def test_of_a_file_for_two_nodes_one_is_read(tmp_path: Path, node: str, mass: float) -> None:
    path = tmp_path / 'ship.yaml'
    path.write_text(OF_TWO)
    assert load_parameters(path, node) == {'bearings': ['aft'], 'aft.mass': mass}


@pytest.mark.parametrize(
    'port', ['/port/stickslip_monitor', '/port/**', '/port/*', '/port/**/stickslip_monitor']
)
def test_a_file_for_two_nodes_raises_a_question(tmp_path: Path, port: str) -> None:
    path = tmp_path / 'ship.yaml'
    path.write_text(OF_TWO.replace('/port/stickslip_monitor', port))
    with pytest.raises(ConfigurationError) as error:
        load_parameters(path)
    assert str(error.value) == (
        f'{path} is for several nodes: choose one of /port/stickslip_monitor,'
        ' /starboard/stickslip_monitor by --node'
    )


@pytest.mark.parametrize(
    ('section', 'matches'),
    [
        ('/**', True),
        ('/*/stickslip_monitor', True),
        ('/**/stickslip_monitor', True),
        ('/port/*', True),
        ('port/stickslip_monitor', True),
        ('/*', False),
        ('/stickslip_monitor', False),
        ('/starboard/*', False),
    ],
)
def test_a_section_is_for_the_nodes_that_rcl_says(tmp_path: Path, section: str, matches: bool) -> None:
    """Expected values are those of rclpy 9.1 for ``/port/stickslip_monitor`` and the same file."""
    path = tmp_path / 'ship.yaml'
    path.write_text(f"'{section}': {{ros__parameters: {{autostart: false}}}}")
    if matches:
        assert load_parameters(path, '/port/stickslip_monitor') == {'autostart': False}
    else:
        with pytest.raises(ConfigurationError, match='no parameters for'):
            load_parameters(path, '/port/stickslip_monitor')


SHIP = ROOT / 'launch_configs/examples/ship.yaml'
OF_NMEA = (
    ('{from: signalk, path: propulsion.port.revolutions}', '{from: nmea, sentence: RPM, kind: S, number: 2}'),
    ('{from: signalk, path: propulsion.port.shaft.aftStern.load}', "{from: nmea, kind: 'N', name: AFTLOAD}"),
)


@pytest.mark.parametrize(
    ('changes', 'columns'),
    [
        ((), ['propulsion.port.revolutions', 'propulsion.port.shaft.aftStern.load']),
        (OF_NMEA, ['RPM S 2', 'AFTLOAD']),
        ((('{unit: Hz,', "{unit: Hz, column: 'n',"),), ['n', 'propulsion.port.shaft.aftStern.load']),
        ((('{unit: Hz,', '{unit: Hz, topic: /n,'),), ['', 'propulsion.port.shaft.aftStern.load']),
    ],
)
def test_the_file_of_a_ship_without_ros_is_for_all_commands(
    tmp_path: Path, changes: Sequence[tuple[str, str]], columns: list[str]
) -> None:
    """Load the file of docs/ship.md, with the buses' names for what their logs have."""
    text = SHIP.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (tmp_path / 'ship.yaml').write_text(text)
    (bearing,) = load_config(tmp_path / 'ship.yaml').bearings
    assert [bearing.speed.column, bearing.load.column] == columns


def test_pairs_of_whole_numbers_and_others_are_a_table_of_the_load(write: Write) -> None:
    # As people write them; a list that mixes them is refused elsewhere, as ROS 2 does.
    text = WHOLE.replace('{topic: /bearing/aft/load', '{over_speed: [[0, 32.5], [60, 28]]')
    assert load_config(write(text)).bearing('aft').load.over_speed == (0.0, 32.5, 60.0, 28.0)
    assert 'a list mixes float and int' in refusal_of(
        write(text.replace('[[0, 32.5], [60, 28]]', '[0, 32.5]'))
    )
    nested = WHOLE.replace('decay: 10.0}', 'decay: 10.0, speed: [[0, 1], [1, 2]]}')
    assert 'aft.friction.speed = [[0.0, 1.0], [1.0, 2.0]] must be a list of finite' in refusal_of(
        write(nested)
    )
