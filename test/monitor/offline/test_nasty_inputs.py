# SPDX-License-Identifier: Apache-2.0
"""The inputs of a bearing in logs as ships, yards and historians write them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path

import pytest
from nasty_logs import COLUMNS, LOGS, nmea_sentence, open_log

from fuzz.mutants import mutant
from stickslip_logs.errors import BagError
from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Request
from stickslip_logs.recordings.table_recording import TableRecording
from stickslip_monitor.cli import main
from stickslip_monitor.monitor.parameter_file import load_config, load_yaml
from stickslip_monitor.monitor.parameters import InputConfig
from stickslip_monitor.offline.check import check_recording
from stickslip_monitor.offline.input_binding import bind

CONFIG = Path(__file__).resolve().parents[3] / 'launch_configs/reference_bearing.yaml'


def bound_inputs(recording: TableRecording, config: Path = CONFIG) -> Mapping[str, InputConfig]:
    """Return the inputs of the bearing, all of which the log must have."""
    bound = bind(recording, load_config(config))
    assert bound.absent == {}
    return bound.config.bearings[0].inputs


@pytest.mark.parametrize('name', LOGS)
def test_every_number_and_every_time(name: str, tmp_path: Path) -> None:
    log, text = LOGS[name], CONFIG.read_text()
    speed, load = COLUMNS.get(name, ('', ''))
    text = text.replace('speed: {topic', f"speed: {{column: '{speed}', topic")
    (tmp_path / 'ship.yaml').write_text(text.replace('load: {topic', f"load: {{column: '{load}', topic"))
    recording = open_log(tmp_path, log.raw)
    inputs = bound_inputs(recording, tmp_path / 'ship.yaml')
    series_of = recording.read([Request(source.topic, 'data') for source in inputs.values()])
    for series, expected in zip(series_of.values(), (log.speed, log.load), strict=True):
        assert series.stamp_ns.tolist() == list(log.times)
        assert series.value.tolist() == pytest.approx(list(expected), rel=1e-12, nan_ok=True)
    assert log.says in ' | '.join(recording.warnings)
    assert log.lost in ' | '.join(recording.losses)
    assert bool(recording.losses) == bool(log.lost)


@pytest.mark.filterwarnings('error')
def test_a_number_that_its_unit_takes_beyond_all_is_read_in_silence(tmp_path: Path) -> None:
    recording = open_log(tmp_path, 'time,speed [Hz],load [N]\n0,0.5,900\n1,1e308,901\n')
    (series,) = recording.read([Request(bound_inputs(recording)['speed'].topic, 'data')]).values()
    assert series.value.tolist() == pytest.approx([30.0, math.inf])


def test_damaged_tables_are_read_or_refused_in_a_sentence(tmp_path: Path) -> None:
    logs, path, refused = [log.raw for log in LOGS.values()], tmp_path / 'a.csv', []
    for seed in range(150):
        path.write_bytes(mutant(seed, logs, 'csv'))
        try:
            recording = open_bag(path)
            bind(recording, load_config(CONFIG))
            recording.read([Request(topic, 'data') for topic in recording.topics])
        except BagError as error:
            refused.append(str(error))
    assert len(refused) < 100
    assert all(text.strip() for text in refused)


@pytest.mark.parametrize(
    ('text', 'quantity'),
    [
        ('time,Shaft RPM,Speed over ground (kn)\n0,30,12\n1,31,12\n', 'load'),
        ('time,Shaft RPM,load [kip]\n0,30,1.2\n1,31,1.2\n', 'load'),
        ('time,Shaft RPM,n\n0,30,1200\n1,31,1200\n', 'load'),  # a count of samples
        ('time,Shaft RPM,load\ns,rpm,kip\n0,30,1.2\n1,31,1.2\n', 'load'),
        ('time,tag,value,unit\n0,n,30,rpm\n0,load,1.2,kip\n1,n,31,rpm\n1,load,1.2,kip\n', 'load'),
        ('time,Shaft RPM,Thrust (kN)\n0,30,600\n1,31,600\n', 'load'),
        ('time,Shaft RPM,load [x10 kN]\n0,30,60\n1,31,60\n', 'load'),
        ('time,Shaft RPM,Load kN/10\n0,30,60\n1,31,60\n', 'load'),
        ('@0 $IIRPM,S,1,30,,A*43\n@0 $IIXDR,P,12.3,B,LOAD*44\n', 'load'),
        ('time,Shaft RPM,load %\n0,30,60\n1,31,60\n', 'load'),
        ('time,Shaft RPM,Load kN [%]\n0,30,60\n1,31,60\n', 'load'),
        ('time,Shaft RPM,Load kN [mV]\n0,30,60\n1,31,60\n', 'load'),
        ('time,Shaft RPM,Load limit [N]\n0,30,60\n1,31,60\n', 'load'),
        *(
            (f'time,{heading},load [N]\n0,30,900\n1,31,901\n', 'speed')
            for heading in (
                *(
                    'Bow thruster rpm',
                    'Grid frequency [Hz]',
                    'Roll velocity [rad/s]',
                    'rpm setpoint',
                    'Engine speed [rpm]',
                    'Alternator (1/min)',
                    'Shaft RPM std',
                    'RPM rate [rpm/s]',
                ),
                *('rpm/10', 'RPM (x0.1)', 'rpm*0.01', 'rpm (0.1)'),
            )
        ),
    ],
)
def test_a_column_of_another_quantity_is_no_input(text: str, quantity: str, tmp_path: Path) -> None:
    """12 knots or 1.2 kips, taken for 12 kN or 1.2 N, would be judged stable."""
    absent = bind(open_log(tmp_path, text), load_config(CONFIG)).absent
    assert list(absent) == [('aft_stern', quantity)]
    assert f'write aft_stern.{quantity}.column' in absent['aft_stern', quantity]


@pytest.mark.parametrize(
    ('heading', 'bearing', 'is_its'),
    [
        ('Port shaft RPM', 'stbd_aft', False),
        ('RPM SB', 'stbd_aft', False),  # which side that is depends on the language
        ('propulsion.port.revolutions [Hz]', 'starboard', False),
        ('Fwd shaft RPM', 'aft_stern', False),
        ('Aft shaft RPM, port', 'port_forward', False),
        ('Shaft RPM aft, port', 'port_aft', True),
        ('Shaft RPM aft', 'port_aft', True),
    ],
)
def test_the_other_side_is_another_shaft(heading: str, bearing: str, is_its: bool, tmp_path: Path) -> None:
    path, config = tmp_path / 'voyage.csv', tmp_path / 'ship.yaml'
    path.write_text(f'time [s],"{heading}",load [N]\n0,30,900\n1,31,901\n')
    config.write_text(CONFIG.read_text().replace('aft_stern', bearing))
    assert ((bearing, 'speed') in bind(open_bag(path), load_config(config)).absent) == (not is_its)


def test_columns_of_one_heading_are_told_apart_by_their_places(tmp_path: Path) -> None:
    recording = open_log(tmp_path, 'time,speed [rpm],speed [rpm],load [N]\n0,30,60,900\n1,30,60,901\n')
    reason = bind(recording, load_config(CONFIG)).absent['aft_stern', 'speed']
    assert "2 columns may be the speed of aft_stern by unit or name (columns: '#2', '#3'): write" in reason
    assert "write aft_stern.speed.column: '#2', or another" in reason


@pytest.mark.parametrize(
    ('headings', 'line'),
    [
        (
            'ME RPM,SOG',
            "speed.column: 'ME RPM', or another, and aft_stern.speed.gear where it is an engine's",
        ),
        ('SOG,Vitesse arbre (tr/min)', "speed.column: 'Vitesse arbre (tr/min)', or another, and"),
        ('sensor.rudder,sensor.shaft_speed', "speed.column: 'sensor.shaft_speed', or another, and"),
        ('PORT RUDDER,PORT SHAFT RPM', "speed.column: 'PORT SHAFT RPM', or another, and"),
        ("Chief's shaft rpm,SOG", "speed.column: 'Chief''s shaft rpm', or another, and"),
        ('Draught,SOG', 'speed.column: NAME, and'),
        ('rpm,Thrust (kN)', 'load.column: NAME, or aft_stern.load.constant'),
        ('rpm,Force of gland', "load.column: 'Force of gland', or another, or aft_stern.load.constant"),
    ],
)
def test_the_line_to_write_names_the_likeliest_column(headings: str, line: str, tmp_path: Path) -> None:
    """Write the line of the message, which the column then answers."""
    text = f'time [s],{headings}\n0,30,12\n1,31,12\n'
    quantity = line.partition('.')[0]
    reason = bind(open_log(tmp_path, text), load_config(CONFIG)).absent['aft_stern', quantity]
    assert f': write aft_stern.{line}' in reason
    config = tmp_path / 'own.yaml'
    config.write_text(f'{CONFIG.read_text()}    aft_stern.{line.partition(", ")[0]}\n')
    absent = bind(open_log(tmp_path, text), load_config(config)).absent
    assert (('aft_stern', quantity) in absent) == ('NAME' in line)


@pytest.mark.parametrize(('gear', 'heading'), [('', 'RPM S 1'), ('gear: 4.2, ', 'RPM E 1')])
def test_a_bus_tells_a_shaft_from_its_engine(gear: str, heading: str, tmp_path: Path) -> None:
    bodies = 'IIRPM,E,1,126,,A', 'IIRPM,S,1,30,,A', 'IIXDR,N,900.0,N,LOAD'
    text = ''.join(f'@0 {nmea_sentence(body)}\n' for body in bodies)
    config = tmp_path / 'ship.yaml'
    config.write_text(CONFIG.read_text().replace('unit: rpm', f'{gear}unit: rpm', 1))
    assert bound_inputs(open_log(tmp_path, text), config)['speed'].column == heading


def test_a_log_of_one_of_two_shafts_is_checked_as_that_one(tmp_path: Path) -> None:
    config = CONFIG.parent / 'two_bearings.yaml'
    log = open_log(tmp_path, 'time [s],rpm,load [N]\n0,30,900\n1,31,901\n')
    bound = bind(log, load_config(config))
    name, quantity = next(of for of in bound.absent)
    assert f'check it with --bearing {name} or another' in bound.absent[name, quantity]
    assert main(['check', str(log.path), '--config', str(config), '--bearing', name]) < 2


def test_the_speed_of_a_thruster_is_that_of_its_own_shaft(tmp_path: Path) -> None:
    config = tmp_path / 'ship.yaml'
    config.write_text(CONFIG.read_text().replace('aft_stern', 'stern_thruster'))
    bound_inputs(open_log(tmp_path, 'time,Stern thruster rpm,load [N]\n0,30,900\n1,31,901\n'), config)


def test_a_column_of_the_topic_is_the_shafts_own(tmp_path: Path) -> None:
    """PlotJuggler writes the field behind the topic, and `data` is no foreign word of it."""
    text = '__time,/shaft/speed/data,/bearing/aft_stern/load/data\n1.7e9,30,900\n1700000000.5,31,901\n'
    assert bind(open_log(tmp_path, text), load_config(CONFIG)).questions == {}


@pytest.mark.parametrize(
    'text',
    [
        '@0 $IIRPM,E,1,500,,A*63\n@0 $IIXDR,N,900.0,N,LOAD*6F\n',
        '{"updates":[{"timestamp":"@0","values":['
        '{"path":"propulsion.port.revolutions","value":0.5},{"path":"shaft.load","value":900}]}]}\n',
    ],
)
def test_the_speed_of_an_engine_raises_a_question(text: str, tmp_path: Path) -> None:
    question = bind(open_log(tmp_path, text), load_config(CONFIG)).questions['aft_stern', 'speed']
    assert "is it the shaft's own? Write aft_stern.speed.column: '" in question
    line = question.partition('Write ')[2]
    assert line.endswith("', and aft_stern.speed.gear where one is between")
    config = tmp_path / 'own.yaml'
    config.write_text(f'{CONFIG.read_text()}    {line.partition(", and")[0]}\n')
    assert ('aft_stern', 'speed') not in bind(open_log(tmp_path, text), load_config(config)).questions


@pytest.mark.parametrize(('name', 'is_asked'), [('LOAD', False), ('AFT LOAD', False), ('PORT LOAD', True)])
def test_the_load_of_another_bearing_raises_a_question(name: str, is_asked: bool, tmp_path: Path) -> None:
    # On a bus the unit of a transducer tells its quantity, and only its name whose it is.
    bodies = 'IIRPM,S,1,30,,A', f'IIXDR,N,900.0,N,{name}'
    text = ''.join(f'@0 {nmea_sentence(body)}\n' for body in bodies)
    bound = bind(open_log(tmp_path, text), load_config(CONFIG))
    question = bound.questions.get(('aft_stern', 'load'), '')
    assert ("is it the bearing's own? Write aft_stern.load.column" in question) == is_asked == bool(question)


@pytest.mark.parametrize(
    ('heading', 'column', 'stated'),
    [
        ('Load [klbf]', 'Load [klbf]', 'klbf'),
        ('Load N [mV]', 'Load N [mV]', 'mV'),
        ('Load N [%]', 'Load N', '%'),
        ('Load [klbf]', '#3', ''),
        ('Load [klbf]', 'Load, scale: 4448.2', ''),
    ],
)
def test_a_column_that_says_another_unit_raises_a_question(
    heading: str, column: str, stated: str, tmp_path: Path
) -> None:
    """Take the place of the column, or a scale, for an answer."""
    name, _, scale = column.partition(',')
    settings = f"load, unit: N, column: '{name}',{scale}{',' * bool(scale)}"
    (tmp_path / 'own.yaml').write_text(CONFIG.read_text().replace('load, unit: N,', settings))
    recording = open_log(tmp_path, f'time [s],rpm,{heading}\n0,30,1.2\n1,31,1.2\n')
    questions = bind(recording, load_config(tmp_path / 'own.yaml')).questions
    text = (
        f"is column '{heading}' in N, and its heading says '{stated}': write"
        " aft_stern.load.column: '#3' if so, else aft_stern.load.scale"
    )
    assert questions == ({('aft_stern', 'load'): text} if stated else {})


def test_a_configured_column_that_is_a_text_of_another_is_found_by_where(tmp_path: Path) -> None:
    config = tmp_path / 'ship.yaml'
    config.write_text(CONFIG.read_text().replace('unit: rpm', 'column: shaft/rpm, unit: rpm', 1))
    lines = ''.join(f'{k},shaft/rpm,30\n{k},aft/load,900\n' for k in range(9))
    recording = open_log(tmp_path, f'time [s],tagpath,floatvalue\n{lines}')
    reason = bind(recording, load_config(config)).absent['aft_stern', 'speed']
    assert "write aft_stern.speed.where: {'tagpath': 'shaft/rpm'} beside the column of its numbers" in reason


@pytest.mark.parametrize(
    ('heading', 'settings', 'is_asked'),
    [
        ('Shaft speed [rpm]', '', True),
        ('rpm', '', True),
        ('rpm', 'column: rpm, ', False),
        ('/shaft/speed', '', False),
    ],
)
def test_a_gear_beside_a_guessed_column_raises_a_question(
    heading: str, settings: str, is_asked: bool, tmp_path: Path
) -> None:
    config = tmp_path / 'ship.yaml'
    config.write_text(CONFIG.read_text().replace('unit: rpm', f'{settings}gear: 4.2, unit: rpm', 1))
    recording = open_log(
        tmp_path, f'time [s],Engine speed [rpm],{heading},load [N]\n0,126,30,9\n1,126,30,9\n'
    )
    question = bind(recording, load_config(config)).questions.get(('aft_stern', 'speed'), '')
    assert ("is it the engine's own? Write aft_stern.speed.column" in question) == is_asked == bool(question)


@pytest.mark.parametrize(
    ('heading', 'of_10_degrees', 'unit'),
    [
        ('Sea water [degC]', 10.0, 'C'),
        ('Sea water (°F)', 50.0, 'C'),
        ('Sea water [K]', 283.15, 'C'),
        ('Sea water, °C', 10.0, 'K'),
        ('sea_water_degF', 50.0, 'K'),
    ],
)
def test_water_is_taken_in_the_unit_of_its_heading(
    heading: str, of_10_degrees: float, unit: str, tmp_path: Path
) -> None:
    """10 C are 50 F and 283.15 K."""
    config = tmp_path / 'ship.yaml'
    text = CONFIG.read_text().replace('decay: 10.0}', 'decay: 10.0, at_temperature: 15.0}')
    config.write_text(
        text.replace(
            '      alarm:', f'      water_temperature: {{column: "{heading}", unit: {unit}}}\n      alarm:'
        )
    )
    lines = [f'{t},120,900,{of_10_degrees}' for t in range(60)]
    (tmp_path / 'voyage.csv').write_text('\n'.join([f'time,rpm,load [N],"{heading}"', *lines, '']))
    (bearing,) = check_recording(tmp_path / 'voyage.csv', load_config(config)).bearings.values()
    water = bearing.inputs[-1]
    assert (water.quantity, water.used, water.questions) == ('water_temperature', 60, ())
    assert water.si_span == pytest.approx((10.0, 10.0), abs=1e-9)


def test_a_level_is_taken_in_the_unit_of_its_heading(tmp_path: Path) -> None:
    """Standard gravity is 9.80665 m/s^2 by definition."""
    config = tmp_path / 'ship.yaml'
    level = "      level: {column: 'Lining [g]', unit: m/s^2}\n      alarm:"
    config.write_text(CONFIG.read_text().replace('      alarm:', level))
    recording = open_log(tmp_path, 'time,rpm,load [N],Lining [g]\n0,30,900,2\n1,31,900,3\n')
    request = Request(bound_inputs(recording, config)['level'].topic, 'data')
    assert recording.read([request])[request].value == pytest.approx([19.6133, 29.41995])


def test_a_shaft_that_is_named_after_its_side_raises_no_question(tmp_path: Path) -> None:
    config = tmp_path / 'ship.yaml'
    config.write_text(CONFIG.read_text().replace('aft_stern', 'port'))
    recording = open_log(
        tmp_path, 'time [s],Port Shaft RPM,Stbd Shaft RPM,load [N]\n0,30,60,900\n1,31,60,901\n'
    )
    bound = bind(recording, load_config(config))
    assert (bound.absent, bound.questions) == ({}, {})


def test_lines_centuries_apart_are_judged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Three times 142 years, in nanoseconds, are no number of 64 bits."""
    text = 'time,speed,load\n1970-01-01 00:00:00,30,900\n2112-01-01 00:00:00,31,901\n'
    (tmp_path / 'voyage.csv').write_text(text)
    assert main(['check', str(tmp_path / 'voyage.csv'), '--config', str(CONFIG)]) in (0, 1)
    assert 'so its timeout is' in capsys.readouterr().out


def test_lines_far_apart_are_reported_and_a_value_counts_for_three_of_them(tmp_path: Path) -> None:
    recording = open_log(tmp_path, 'time,rpm,kN\n' + ''.join(f'{20 * k},30,1\n' for k in range(30)))
    inputs = bound_inputs(recording)
    assert inputs['speed'].timeout_ns == inputs['load'].timeout_ns == 60 * 10**9
    warnings = ' '.join(recording.warnings)
    assert warnings.count('lines are 20 s apart, so its timeout is 60 s here') == 2


def test_a_log_is_not_played_and_a_way_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / 'voyage.csv').write_text('time,speed,load\n0,30,900\n1,31,901\n')
    assert main(['play', str(tmp_path / 'voyage.csv')]) == 2
    assert 'make a bag of it by stickslip check with' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('text', 'speed', 'says'),
    [
        # The gear of docs/ship.md: 4 turns of the engine are one of the shaft, live as well.
        (
            '{"updates":[{"timestamp":"2026-04-13T10:00:00Z","values":['
            '{"path":"propulsion.port.revolutions","value":2},{"path":"shaft.load","value":900}]}]}\n',
            30.0,
            'times its scale 0.25',
        ),
        ('time,Engine speed,load [N]\n0,120,900\n1,120,901\n', 30.0, 'times its scale 0.25'),
        ('time,Shaft speed [rpm],load [N]\n0,30,900\n1,30,901\n', 30.0, 'taken as scaled already'),
    ],
)
def test_numbers_that_are_still_to_be_scaled(text: str, speed: float, says: str, tmp_path: Path) -> None:
    config = tmp_path / 'ship.yaml'
    settings = (
        "unit: rpm, scale: 0.25, column: 'Engine speed'" if 'speed,' in text else 'unit: rpm, scale: 0.25'
    )
    config.write_text(CONFIG.read_text().replace('unit: rpm', settings, 1))
    recording = open_log(tmp_path, text)
    (bearing,) = bind(recording, load_config(config)).config.bearings
    request = Request(bearing.speed.topic, 'data')
    assert 0.25 * recording.read([request])[request].value[0] == pytest.approx(speed)
    assert any(says in warning for warning in recording.warnings)


@pytest.mark.parametrize(
    ('heading', 'lost'),
    [
        ('Load [N]', {('aft', 'load'), ('mid', 'load')}),
        ('Aft load [N]', {('mid', 'load')}),
        ('/aft/load', {('mid', 'load')}),
        ('Load [N],Load mid [N]', set()),
    ],
)
def test_one_column_is_not_the_load_of_two_bearings(
    heading: str, lost: set[tuple[str, str]], tmp_path: Path
) -> None:
    config, text = tmp_path / 'ship.yaml', CONFIG.read_text()
    head, section = text.split('    aft_stern:\n')
    sections = [
        f'    {name}:\n' + section.replace('/bearing/aft_stern/load', f'/{name}/load')
        for name in ('aft', 'mid')
    ]
    config.write_text(head.replace('[aft_stern]', '[aft, mid]') + ''.join(sections))
    loads = ',900' * (heading.count(',') + 1)
    bound = bind(open_log(tmp_path, f'time,rpm,{heading}\n0,30{loads}\n1,31{loads}\n'), load_config(config))
    assert bound.absent.keys() == lost


def test_one_column_that_both_bearings_name_is_the_load_of_two(tmp_path: Path) -> None:
    config, text = tmp_path / 'ship.yaml', CONFIG.read_text()
    head, section = text.split('    aft_stern:\n')
    sections = (
        f'    {name}:\n' + section.replace('/bearing/aft_stern/load', f"/{name}/load, column: 'Load [N]'")
        for name in ('aft', 'mid')
    )
    config.write_text(head.replace('[aft_stern]', '[aft, mid]') + ''.join(sections))
    bound = bind(open_log(tmp_path, 'time,rpm,Load [N]\n0,30,900\n1,31,901\n'), load_config(config))
    assert bound.absent == {}


def test_an_assumed_load_is_absent_with_its_speed(tmp_path: Path) -> None:
    """Judge the bearing whose speed is there, beside one whose speed is not."""
    head, section = CONFIG.read_text().split('    aft_stern:\n')
    load = next(line for line in section.splitlines() if line.strip().startswith('load:'))
    section = section.replace(load, '      load: {constant: 1000.0, unit: N}')
    sections = [
        f'    {name}:\n' + section.replace('unit: rpm', f'unit: rpm, column: {name} rpm')
        for name in ('aft', 'mid')
    ]
    config = tmp_path / 'ship.yaml'
    config.write_text(head.replace('[aft_stern]', '[aft, mid]') + ''.join(sections))
    recording = open_log(tmp_path, 'time,aft rpm\n0,30\n1,31\n')
    assert bind(recording, load_config(config)).absent.keys() == {('mid', 'speed'), ('mid', 'load')}
    report = check_recording(recording.path, load_config(config))
    assert [bearing.evaluations > 0 for bearing in report.bearings.values()] == [True, False]


def test_a_scale_beside_a_named_column_applies(tmp_path: Path) -> None:
    # The engine of a 4:1 gear at 80 rpm turns the shaft at 20 rpm, whatever unit its heading has.
    config = tmp_path / 'ship.yaml'
    settings = "unit: rpm, scale: 0.25, column: 'ME [rpm]'"
    config.write_text(CONFIG.read_text().replace('unit: rpm', settings, 1))
    recording = open_log(tmp_path, 'time,ME [rpm],load [N]\n0,80,900\n1,80,901\n')
    (bearing,) = bind(recording, load_config(config)).config.bearings
    request = Request(bearing.speed.topic, 'data')
    assert bearing.speed.scale * recording.read([request])[request].value[0] == pytest.approx(20.0)
    assert any('times its scale 0.25' in warning for warning in recording.warnings)


def test_an_engine_with_a_gear_and_a_load_from_the_alignment_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """571.2 rpm over 4.2 are 136, 100.8 are 24, where the table has 1760 N; only the speed is at fault."""
    load = next(line for line in CONFIG.read_text().splitlines() if line.strip().startswith('load:'))
    text = CONFIG.read_text().replace(
        load, '      load: {over_speed: [[0, 2000], [100, 1000.0], [200, 611.11]], unit: N}'
    )
    config, log = tmp_path / 'ship.yaml', tmp_path / 'voyage.csv'
    config.write_text(text.replace('unit: rpm', "unit: rpm, gear: 4.2, column: 'ME [rpm]'", 1))
    speeds = [571.2 if t < 60 or t % 2 else 100.8 for t in range(120)]
    log.write_text('time,ME [rpm]\n' + ''.join(f'{t},{rpm}\n' for t, rpm in enumerate(speeds)))
    assert main(['check', str(log), '--config', str(config), '--json']) == 1
    document = json.loads(capsys.readouterr().out)
    (bearing,) = document['bearings'].values()
    speed, load = (bearing['inputs'][name] for name in ('speed', 'load'))
    assert speed['values'].startswith('100.8 to 571.2 rpm of an engine with a gear of 4.2 (')
    assert load['values'] == '611.1 to 2000 N from the alignment table'
    assert load['assumed'] is True
    assert [len(record['source_faults']) for record in (speed, load)] == [1, 0]
    assert any('of an engine with a gear of 4.2' in text for text in document['warnings'])
    assert 'Now 24 rpm, 1.76 kN (from the alignment table)' in bearing['events'][0]['text']


@pytest.mark.parametrize(('every', 'code'), [(3, 1), (4, 0)])
def test_a_third_of_implausible_speeds_is_no_quiet_voyage(every: int, code: int, tmp_path: Path) -> None:
    # As live, where a third of the samples refused is a fault: 4000 rpm is beyond any shaft of a ship.
    rows = ''.join(f'{t},{4000 if t % every == 0 else 136},1000\n' for t in range(1, 121))
    (tmp_path / 'voyage.csv').write_text(f'time [s],speed [rpm],load [N]\n{rows}')
    assert main(['check', str(tmp_path / 'voyage.csv'), '--config', str(CONFIG)]) == code


@pytest.mark.parametrize(('port', 'stbd'), [('port', 'stbd'), ('1A', '2A'), ('1 B', '2 B'), ('-1A', '-2A')])
def test_lines_of_two_shafts_are_refused_or_chosen(tmp_path: Path, port: str, stbd: str) -> None:
    # Mixed to one speed, stick-slip of one shaft is hidden by the other.
    text = 'time,shaft,rpm,load [N]\n' + ''.join(
        f'{t},{shaft},{rpm},{load}\n'
        for t in range(9)
        for shaft, rpm, load in ((port, 30, 900), (stbd, 60, 800))
    )
    recording = open_log(tmp_path, text)
    absent = bind(recording, load_config(CONFIG)).absent
    assert list(absent) == [('aft_stern', 'speed'), ('aft_stern', 'load')]
    line = f"write aft_stern.speed.where: {{'shaft': '{port}'}}"
    assert f"told apart by column 'shaft' ('{port}', '{stbd}'): {line}" in absent['aft_stern', 'speed']
    document = load_yaml(CONFIG)
    parameters = document['/**']['ros__parameters']
    bearing = parameters.pop('aft_stern')
    parameters['bearings'] = ['port', 'stbd']
    for name, shaft in ('port', port), ('stbd', stbd):
        inputs = {key: bearing[key] | {'where': {'shaft': shaft}} for key in ('speed', 'load')}
        parameters[name] = bearing | inputs
    (tmp_path / 'ship.yaml').write_text(json.dumps(document))
    bound = bind(recording, load_config(tmp_path / 'ship.yaml'))
    assert bound.absent == {}
    topics = [
        source.topic for bearing_config in bound.config.bearings for source in bearing_config.inputs.values()
    ]
    series_of = recording.read([Request(topic, 'data') for topic in topics])
    assert [series.value.tolist() for series in series_of.values()] == [[n] * 9 for n in (30, 900, 60, 800)]


def test_a_question_about_an_input_is_exit_code_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Check a quiet log whose column is in the heading's unit, with a scale for another unit."""
    (tmp_path / 'voyage.csv').write_text(
        'time [s],speed [rpm],load [N]\n' + ''.join(f'{t},120,{900 + t % 7}\n' for t in range(60))
    )
    plain = CONFIG.read_text()
    codes = []
    for number, text in enumerate((plain, plain.replace('unit: rpm', 'unit: rpm, scale: 0.25', 1))):
        (tmp_path / f'{number}.yaml').write_text(text)
        codes.append(
            main(['check', str(tmp_path / 'voyage.csv'), '--config', str(tmp_path / f'{number}.yaml')])
        )
    assert codes == [0, 1]
    assert 'so its scale 0.25 and offset 0 are not applied: write' in ' '.join(
        capsys.readouterr().out.split()
    )


@pytest.mark.parametrize(
    'names', [('{shaft="a"}', '{shaft="b"}'), ('yes', 'no'), ("it's", '- 2026-05-04: #')]
)
@pytest.mark.parametrize('heading', ['labels', 'Ship: name', 'on'])
def test_the_line_that_is_proposed_chooses_the_rows(
    heading: str, names: tuple[str, str], tmp_path: Path
) -> None:
    rows = ''.join(
        f'{t},"{name.replace(chr(34), 2 * chr(34))}",{rpm},900\n'
        for t in range(9)
        for name, rpm in zip(names, (30, 60), strict=True)
    )
    recording = open_log(tmp_path, f'time,{heading},rpm,load [N]\n{rows}')
    question = bind(recording, load_config(CONFIG)).absent['aft_stern', 'speed']
    line = question.split('write aft_stern.speed.')[1].removesuffix(', and a bearing for each')
    text = CONFIG.read_text()
    for unit in ('unit: rpm', 'unit: N'):
        text = text.replace(unit, f'{unit}, {line}')
    (tmp_path / 'ship.yaml').write_text(text)
    assert not bind(recording, load_config(tmp_path / 'ship.yaml')).absent


def test_a_log_goes_on_where_its_speed_and_load_end(tmp_path: Path) -> None:
    """Half an hour without speed and load is no quiet voyage: other columns go on."""
    lines = [f'{t},{"120,900" if 600 <= t < 1200 else ","},7' for t in range(1800)]
    (tmp_path / 'voyage.csv').write_text('\n'.join(['time,speed [rpm],load [N],wind', *lines, '']))
    report = check_recording(tmp_path / 'voyage.csv', load_config(CONFIG))
    (bearing,) = report.bearings.values()
    assert (report.start_ns, report.end_ns) == (0, 1799 * 10**9)
    assert [(str(event.after), event.time_ns // 10**9) for event in bearing.events] == [
        ('input_stale', 5),
        ('normal', 600),
        ('input_stale', 1204),
    ]
