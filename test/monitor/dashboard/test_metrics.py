# SPDX-License-Identifier: Apache-2.0
"""The figures for Prometheus, and the real Prometheus that scrapes them."""

from __future__ import annotations

import json
import math
import re
import shutil
import subprocess
import threading
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import pytest
import yaml
from shared import DEADLINE, ROOT, until

from benchmarks.signalk_servers import free_port

parser = pytest.importorskip('prometheus_client.parser', reason="the extra 'dashboard' is not installed")

SHIPPED = ROOT / 'launch_configs' / 'dashboards'
RULE_TESTS = [str(Path(__file__).parent / f'prometheus_{name}_test.yml') for name in ('rules', 'day')]
SPACE = {'namespace': '/'}
TOKEN = 'correct-horse-battery'
Figures = dict[tuple[str, frozenset[tuple[str, str]]], float]


def find_program(name: str) -> str:
    """Return the path of a program of Debian's package prometheus."""
    path = shutil.which(name)
    if path is None:
        pytest.skip(f'{name} is not installed (apt install prometheus)')
    return path


def scrape(dashboard: Any) -> str:
    with urllib.request.urlopen(f'{dashboard.url}metrics', timeout=DEADLINE) as answer:
        return str(answer.read().decode())


def parse_metrics(text: str) -> Figures:
    """Return every sample by its name and labels, as the reference parser reads it."""
    return {
        (sample.name, frozenset(sample.labels.items())): sample.value
        for family in parser.text_string_to_metric_families(text)
        for sample in family.samples
    }


def metric_of(metrics: Figures, name: str, **labels: str) -> float:
    return metrics[f'stickslip_{name}', frozenset(labels.items())]


def test_metrics_equal_the_assessment_of_the_bearing(dashboard: Any) -> None:
    dashboard.sail(20.0, 1000.0, 5.0)
    point = dashboard.ship.session.monitor.bearings['aft_stern'].verdict.assessment
    metrics = parse_metrics(scrape(dashboard))
    bearing = {'namespace': '/', 'bearing': 'aft_stern'}
    # A journal of 0.1 m at 20 rpm.
    assert metric_of(metrics, 'speed_meters_per_second', **bearing) == pytest.approx(math.pi * 0.1 / 3.0)
    assert metric_of(metrics, 'load_newtons', **bearing) == 1000.0
    for name, value in {
        'hopf_speed_meters_per_second': point.hopf_speed,
        'fold_margin_ratio': point.fold_margin,
        'growth_rate_hertz': point.growth_rate,
        'amplitude_meters': point.amplitude,
        'exact_amplitude_meters': point.amplitude_exact,
    }.items():
        assert metric_of(metrics, name, **bearing) == pytest.approx(value, rel=1e-8)
    assert ('stickslip_threshold_amplitude_meters', frozenset(bearing.items())) not in metrics
    # The fold of 40.7231 rpm with margin and hysteresis of the file, 1.12, rounded up: as the text says.
    assert metric_of(metrics, 'speed_to_reach_rpm', **bearing, order='raise_speed') == 46.0
    assert metric_of(metrics, 'predicted', **bearing) == 1.0
    assert metric_of(metrics, 'samples_total', **bearing, input='load', status='accepted') == 5.0
    assert 0.0 <= metric_of(metrics, 'sample_age_seconds', **bearing, input='load') < 30.0
    conditions = {dict(k[1])['condition']: v for k, v in metrics.items() if k[0].endswith('dition')}
    assert [name for name, value in conditions.items() if value] == ['stick_slip']


def test_the_states_of_an_alarm(dashboard: Any) -> None:
    dashboard.sail(20.0, 1000.0, 5.0)
    labels = {'namespace': '/', 'bearing': 'aft_stern', 'alarm': 'stick_slip', 'priority': 'alarm'}

    def state() -> list[str]:
        metrics = parse_metrics(scrape(dashboard))
        states = {
            dict(labels_of_row)['state']: value
            for (name, labels_of_row), value in metrics.items()
            if name == 'stickslip_alarm_state' and labels.items() <= dict(labels_of_row).items()
        }
        assert len(states) == 8
        return [name for name, value in states.items() if value]

    assert state() == ['unacknowledged']
    metrics = parse_metrics(scrape(dashboard))
    assert metric_of(metrics, 'alarm_active', **labels) == 1.0
    assert (
        metric_of(metrics, 'alarms_unacknowledged', **SPACE)
        == metric_of(metrics, 'alarms_sounding', **SPACE)
        == 1.0
    )
    dashboard.sail(60.0, 1000.0, 40.0)
    assert state() == ['returned_unacknowledged']
    metrics = parse_metrics(scrape(dashboard))
    assert (
        metric_of(metrics, 'alarm_active', **labels) == metric_of(metrics, 'alarms_sounding', **SPACE) == 0.0
    )
    # Without a cycle the amplitude is nothing, as on the topic.
    assert metric_of(metrics, 'amplitude_meters', namespace='/', bearing='aft_stern') == 0.0
    assert metric_of(metrics, 'exact_amplitude_meters', namespace='/', bearing='aft_stern') == 0.0


def test_nothing_old_is_repeated(dashboard: Any) -> None:
    assert set(parse_metrics(scrape(dashboard))) == {
        ('stickslip_monitor_up', frozenset(SPACE.items())),
        ('stickslip_bearing_up', frozenset({**SPACE, 'bearing': 'aft_stern'}.items())),
        ('stickslip_dashboard_readers', frozenset()),
    }
    dashboard.sail(60.0, 1000.0)
    assert metric_of(parse_metrics(scrape(dashboard)), 'monitor_up', **SPACE) == 1.0
    dashboard.do(lambda: dashboard.ship.fall_silent(100.0))
    metrics = parse_metrics(scrape(dashboard))
    assert {name for name, _ in metrics} == {
        'stickslip_monitor_up',
        'stickslip_bearing_up',
        'stickslip_dashboard_readers',
        'stickslip_monitor_silence_seconds',
    }
    assert metric_of(metrics, 'monitor_up', **SPACE) == 0.0
    assert metric_of(metrics, 'monitor_silence_seconds', **SPACE) == pytest.approx(100.0)


def test_names_keep_the_conventions(dashboard: Any) -> None:
    tool = find_program('promtool')
    dashboard.sail(36.0, 1000.0, 5.0)
    done = subprocess.run([tool, 'check', 'metrics'], input=scrape(dashboard), text=True, capture_output=True)
    assert (done.returncode, done.stdout + done.stderr) == (0, '')


@pytest.mark.parametrize(
    'arguments',
    [
        ('check', 'rules', str(SHIPPED / 'prometheus_rules.yml')),
        ('test', 'rules', *RULE_TESTS),
        # Without --syntax-only it asks for the token's file, which a ship has.
        ('check', 'config', '--syntax-only', str(SHIPPED / 'prometheus.yml')),
    ],
    ids=lambda arguments: ' '.join(arguments[:2]),
)
def test_the_shipped_files_please_promtool(arguments: tuple[str, ...]) -> None:
    done = subprocess.run([find_program('promtool'), *arguments], text=True, capture_output=True)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
def test_a_real_prometheus_scrapes_with_a_token_and_alerts(dashboards: Any, tmp_path: Path) -> None:
    """Scrape with the shipped files, but for addresses, pace, and the place of the token."""
    dashboard, port = dashboards(token=TOKEN), free_port()
    alerted: list[str] = []

    class Alertmanager(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers['Content-Length']))
            alerted.extend(alert['labels']['alertname'] for alert in json.loads(body))
            self.send_response(200)
            self.end_headers()

        def log_message(self, *_: Any) -> None:
            """Print nothing."""

    receiver = HTTPServer(('127.0.0.1', 0), Alertmanager)
    threading.Thread(target=receiver.serve_forever, daemon=True).start()
    config = yaml.safe_load((SHIPPED / 'prometheus.yml').read_text('utf-8'))
    paces = ('scrape_interval', 'scrape_timeout', 'evaluation_interval')
    config['global'] = dict.fromkeys(paces, '200ms')
    (job,) = config['scrape_configs']
    job['static_configs'] = [{'targets': [f'127.0.0.1:{dashboard.port}']}]
    assert job['authorization'] == {'credentials_file': '/etc/stickslip_monitor/token'}
    job['authorization'] = {'credentials_file': 'token'}
    (manager,) = config['alerting']['alertmanagers']
    manager['static_configs'] = [{'targets': [f'127.0.0.1:{receiver.server_port}']}]
    (tmp_path / 'token').write_text(TOKEN)
    (tmp_path / 'prometheus.yml').write_text(yaml.safe_dump(config))
    shutil.copy(SHIPPED / 'prometheus_rules.yml', tmp_path)
    command = [find_program('prometheus'), f'--config.file={tmp_path}/prometheus.yml']
    command += [f'--web.listen-address=127.0.0.1:{port}', f'--storage.tsdb.path={tmp_path}']

    def ask(path: str, rpm: float) -> Any:
        dashboard.sail(rpm, 1000.0)
        try:
            with urllib.request.urlopen(f'http://127.0.0.1:{port}/api/v1/{path}') as answer:
                return json.load(answer)['data']
        except OSError:  # it is not up yet
            return {'result': [], 'alerts': []}

    def firing(rpm: float) -> set[str]:
        alerts = ask('alerts', rpm)['alerts']
        return {a['labels']['alertname'] for a in alerts if a['state'] == 'firing'}

    server = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        load = 'query?query=stickslip_load_newtons'
        (series,) = until(lambda: ask(load, 60.0)['result'], 'the first scrape')
        assert float(series['value'][1]) == 1000.0
        assert series['metric']['bearing'] == 'aft_stern'
        assert firing(60.0) == set()
        until(lambda: firing(20.0) == {'StickSlipPredicted'}, 'the alert')
        until(lambda: firing(20.0) and 'StickSlipPredicted' in alerted, 'the Alertmanager is told')
    finally:
        receiver.shutdown()
        server.terminate()
        server.wait()


def test_every_alert_is_tested_and_asks_for_what_there_is(dashboard: Any) -> None:
    dashboard.sail(36.0, 1000.0, 5.0)
    rules = yaml.safe_load((SHIPPED / 'prometheus_rules.yml').read_text('utf-8'))
    every = [rule for group in rules['groups'] for rule in group['rules']]
    alerts = {rule['alert']: rule['expr'] for rule in every if 'alert' in rule}
    records = {rule['record'] for rule in every if 'record' in rule}
    tests = [yaml.safe_load(Path(path).read_text()) for path in RULE_TESTS]
    fired = {
        test['alertname']
        for file in tests
        for group in file['tests']
        for test in group['alert_rule_test']
        if test.get('exp_alerts')
    }
    assert fired == set(alerts)
    dashboard.do(lambda: dashboard.board.links.update(nmea_in=True))
    metrics = {name for name, _ in parse_metrics(scrape(dashboard))}
    from stickslip_monitor.dashboard.metrics import GAUGES

    metrics |= {f'stickslip_{name}' for name, _ in GAUGES.values()}
    panels = json.loads((SHIPPED / 'grafana.json').read_text('utf-8'))['panels']
    queries = [target['expr'] for panel in panels for target in panel.get('targets', ())]
    text = '\n'.join([*(rule['expr'] for rule in every), *queries])
    assert set(re.findall(r'stickslip_\w+', text)) <= metrics
    assert set(re.findall(r'stickslip:[\w:]+', text)) == records


def test_every_query_of_grafana_is_one(tmp_path: Path) -> None:
    board = json.loads((SHIPPED / 'grafana.json').read_text('utf-8'))
    panels = board['panels']
    kinds = {requirement['id'] for requirement in board['__requires']} - {'grafana', 'prometheus'}
    assert kinds == {panel['type'] for panel in panels}
    assert len({panel['id'] for panel in panels}) == len(panels)
    queries = [t for panel in panels for t in panel.get('targets', ())]
    rules = [{'record': f'r:{k}', 'expr': re.sub(r'\$\w+', '.*', t['expr'])} for k, t in enumerate(queries)]
    path = tmp_path / 'rules.yml'
    path.write_text(yaml.safe_dump({'groups': [{'name': 'g', 'rules': rules}]}))
    checked = subprocess.run([find_program('promtool'), 'check', 'rules', str(path)], capture_output=True)
    assert checked.returncode == 0, checked.stdout + checked.stderr


def test_grafana_can_be_given_the_board_by_its_provisioning() -> None:
    # Provisioning answers no ``__inputs``: the name of a data source has to be a variable.
    board = json.loads((SHIPPED / 'grafana.json').read_text('utf-8'))
    assert '__inputs' not in board
    assert board['id'] is None
    assert board['uid'] == 'stickslip'
    variables = board['templating']['list']
    sources = {f'${{{variable["name"]}}}' for variable in variables if variable['type'] == 'datasource'}
    assert [variable['query'] for variable in variables if variable['type'] == 'datasource'] == ['prometheus']

    def used(part: Any) -> Iterator[str]:
        items = part.items() if isinstance(part, dict) else enumerate(part) if isinstance(part, list) else ()
        for key, value in items:
            if key == 'datasource' and value['type'] == 'prometheus':
                yield value['uid']
            yield from used(value)

    assert set(used(board)) == sources
    # A query of one variable may use those before it only.
    for number, variable in enumerate(variables):
        used_names = set(re.findall(r'\$\{?(\w+)', json.dumps(variable.get('query', ''))))
        assert used_names <= {earlier['name'] for earlier in variables[:number]}


def test_alertmanager_takes_its_example() -> None:
    path = str(SHIPPED / 'alertmanager.yml')
    checked = subprocess.run([find_program('amtool'), 'check-config', path], capture_output=True)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    # What is inhibited, and by what, are alerts that there are; stick-slip itself never is.
    rules = yaml.safe_load((SHIPPED / 'prometheus_rules.yml').read_text('utf-8'))
    names = {r['alert'] for group in rules['groups'] for r in group['rules'] if 'alert' in r}
    inhibit_rules = yaml.safe_load(Path(path).read_text('utf-8'))['inhibit_rules']
    sides = [
        [r[k][0].split('"')[1].split('|') for r in inhibit_rules]
        for k in ('source_matchers', 'target_matchers')
    ]
    assert {n for side in sides for names_of_rule in side for n in names_of_rule} <= names
    assert 'StickSlipPredicted' not in {n for names_of_rule in sides[1] for n in names_of_rule}
