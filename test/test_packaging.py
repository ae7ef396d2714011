# SPDX-License-Identifier: Apache-2.0
"""What pip and colcon install, and whether colcon's verdict on the tests can be believed."""

from __future__ import annotations

import ast
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock
from xml.etree import ElementTree

import pytest
from shared import ROOT, Program

from stickslip_monitor import cli

NAME = 'stickslip_monitor'
PACKAGES = ('stickslip_logs', NAME, 'stickslip_lab')
SHARE = Path('share') / NAME
MARKER = Path('share/ament_index/resource_index/packages') / NAME
PIP = (sys.executable, '-m', 'pip', '--quiet', '--disable-pip-version-check')
MADE = ('build', 'dist', 'install', 'log', '*.egg-info', '__pycache__', '.*_cache', 'node_modules')


def clean_environment(extra: dict[str, str] | None = None) -> dict[str, str]:
    """Return the environment without what an outer pytest or another colcon has put there."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(('PYTEST_', 'COLCON_'))}
    tools = os.pathsep.join([sysconfig.get_path('scripts'), environment.get('PATH', os.defpath)])
    return environment | {'PATH': tools} | (extra or {})


def run_command(*command: object, cwd: Path, env: dict[str, str] | None = None) -> str:
    """Return a command's output; fail unless it went well."""
    options = {
        'cwd': cwd,
        'env': clean_environment(env),
        'stdout': subprocess.PIPE,
        'stderr': subprocess.STDOUT,
    }
    completed = subprocess.run([str(part) for part in command], **options, text=True, timeout=300)
    assert completed.returncode == 0, completed.stdout
    return completed.stdout


def list_files(folder: str) -> set[Path]:
    """Return the files of a folder of the repository, but those that Python compiled."""
    files = {path.relative_to(ROOT) for path in (ROOT / folder).rglob('*') if path.is_file()}
    return {path for path in files if '__pycache__' not in path.parts}


@pytest.fixture(scope='module')
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Copy the package, so that building leaves no trace in the tree."""
    target = tmp_path_factory.mktemp('workspace') / 'src' / NAME
    shutil.copytree(ROOT, target, ignore=shutil.ignore_patterns('.git', '.venv', *MADE))
    return target


# --- the manifest ------------------------------------------------------------------------------


def test_manifest_keeps_the_rules_of_format_3() -> None:
    package = pytest.importorskip('catkin_pkg.package')
    warnings: list[str] = []
    manifest = package.parse_package(str(ROOT), warnings=warnings)
    assert warnings == []
    assert manifest.package_format == 3
    assert manifest.name == NAME
    assert manifest.licenses == ['Apache-2.0']
    assert manifest.get_build_type() == 'ament_python'


# What an import is called for pip, and for rosdep: None where it has no key, and is optional.
DISTRIBUTIONS: dict[str, tuple[str, str | None]] = {
    'distributed': ('distributed', None),
    'lz4': ('lz4', 'mcap-ros2-support'),
    'mcap': ('mcap', 'mcap-ros2-support'),
    'mcap_ros2': ('mcap-ros2-support', 'mcap-ros2-support'),
    'prometheus_client': ('prometheus-client', 'python3-prometheus-client'),
    'pyarrow': ('pyarrow', None),
    'rclpy': ('ros-kilted-rclpy', 'rclpy'),
    'yaml': ('PyYAML', 'python3-yaml'),
    'zstandard': ('zstandard', 'mcap-ros2-support'),
}


def distribution_names(name: str) -> tuple[str, str | None]:
    """Return the names of an imported package for pip and for rosdep."""
    if name.endswith(('_msgs', '_srvs', '_interfaces')):
        return f'ros-kilted-{name.replace("_", "-")}', name
    return DISTRIBUTIONS.get(name, (name, f'python3-{name}'))


def test_every_import_is_a_declared_dependency() -> None:
    trees = [
        ast.parse(path.read_text('utf-8')) for package in PACKAGES for path in (ROOT / package).rglob('*.py')
    ]
    nodes = [node for tree in trees for node in ast.walk(tree)]
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    names |= {str(n.module) for n in nodes if isinstance(n, ast.ImportFrom) and not n.level}
    tops = {name.split('.')[0] for name in names} - sys.stdlib_module_names - set(PACKAGES)
    manifest = {dependency.text for dependency in ElementTree.parse(ROOT / 'package.xml').iter('exec_depend')}
    listed = (ROOT / 'setup.py').read_text('utf-8')
    providers = {name: distribution_names(name) for name in tops}
    assert {'numpy', 'mcap', 'rclpy', 'std_msgs'} <= providers.keys()
    assert {name: pip for name, (pip, _) in providers.items() if f"'{pip}" not in listed} == {}
    assert {name: key for name, (_, key) in providers.items() if key not in {None, *manifest}} == {}


def test_versions_agree() -> None:
    printed = run_command(sys.executable, '-W', 'ignore', 'setup.py', '--version', cwd=ROOT)
    lines = (ROOT / 'CHANGELOG.rst').read_text('utf-8').splitlines()
    sections = [above for above, below in pairwise(lines) if below and set(below) == {'-'}]
    released = [title.split()[0] for title in sections if re.fullmatch(r'[\d.]+ \(.*\d\)', title)]
    manifest = ElementTree.parse(ROOT / 'package.xml').findtext('version')
    citation = (ROOT / 'CITATION.cff').read_text('utf-8')
    build = printed.split()[-1]
    # pip takes no wheel of the version that is installed: a build has never that of a release.
    assert (build in released) == (sections[0].split()[0] == released[0])
    assert manifest == build.removesuffix('.dev0')
    assert f'\nversion: {released[0]}\n' in citation


# --- pip ---------------------------------------------------------------------------------------


@pytest.fixture(scope='module')
def wheel(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build a wheel with the setuptools that is there: a test needs no network."""
    setuptools = pytest.importorskip('setuptools')
    builtin = tuple(map(int, setuptools.__version__.split('.')[:2])) >= (70, 1)
    if not builtin and importlib.util.find_spec('wheel') is None:
        pytest.skip('setuptools before 70.1 builds wheels only with the package "wheel"')
    target = tmp_path_factory.mktemp('wheel')
    run_command(*PIP, 'wheel', '--no-deps', '--no-build-isolation', '-w', target, source, cwd=target)
    (built,) = target.glob('*.whl')
    return built


@pytest.mark.slow
def test_wheel_holds_the_package_and_its_share_and_no_more(wheel: Path) -> None:
    inside = {Path(name) for name in zipfile.ZipFile(wheel).namelist()}
    for package in PACKAGES:
        assert {p for p in inside if p.parts[0] == package} == list_files(package)
    shared = {Path(*p.parts[2:]) for p in inside if p.parts[0].endswith('.data')}
    assert shared == {MARKER, SHARE / 'package.xml'} | {SHARE / p for p in list_files('launch_configs')}
    assert any(path.name == 'LICENSE' for path in inside)
    tops = {path.parts[0].rpartition('.')[2] for path in inside}
    assert tops == {*PACKAGES, 'data', 'dist-info'}


@pytest.mark.slow
def test_pip_puts_both_commands_on_the_path_and_launch_files_where_ros_looks(
    wheel: Path, tmp_path: Path
) -> None:
    into = ('--no-deps', '--ignore-installed', '--prefix', tmp_path)
    run_command(*PIP, 'install', *into, wheel, cwd=tmp_path)
    scripts = {path.name for path in tmp_path.rglob('*bin/*')}
    assert {'monitor', 'stickslip'} <= scripts
    pytest.importorskip('ament_index_python')
    import_line = 'from ament_index_python.packages import get_package_share_directory as share'
    prefix = {'AMENT_PREFIX_PATH': str(tmp_path)}
    printed = run_command(
        sys.executable, '-c', f"{import_line}; print(share('{NAME}'))", cwd=ROOT, env=prefix
    )
    assert (Path(printed.strip()) / 'launch_configs' / 'monitor.launch.py').is_file()


@pytest.mark.slow
def test_the_container_is_built_from_the_sources_of_a_wheel(
    source: Path, wheel: Path, tmp_path: Path
) -> None:
    """Build the same wheel from what .dockerignore lets through; every line of the file is sound."""
    allowed = [
        line[1:] for line in (ROOT / '.dockerignore').read_text('utf-8').splitlines() if line.startswith('!')
    ]
    context = tmp_path / 'context'
    context.mkdir()
    for name in allowed:
        copy = shutil.copytree if (source / name).is_dir() else shutil.copy
        copy(source / name, context / name)
    run_command(*PIP, 'wheel', '--no-deps', '--no-build-isolation', '-w', tmp_path, context, cwd=tmp_path)
    (built,) = tmp_path.glob('*.whl')
    assert zipfile.ZipFile(built).namelist() == zipfile.ZipFile(wheel).namelist()
    text = (ROOT / 'Containerfile').read_text('utf-8').replace('\\\n', ' ')
    lines = dict(re.findall(r'^(ENTRYPOINT|CMD|HEALTHCHECK) (.*)$', text, re.MULTILINE))
    assert json.loads(lines['ENTRYPOINT']) == ['monitor']
    assert json.loads(lines['CMD'])[:2] == ['--ros-args', '--params-file']
    health = json.loads(lines['HEALTHCHECK'].partition('CMD ')[2])
    assert cli._make_parser(health[1]).parse_args(health[1:]).timeout < 15.0
    (extras,) = re.findall(r"'/src\[(.*)\]'", text)
    listed = (ROOT / 'setup.py').read_text('utf-8')
    assert all(f"'{extra}': " in listed for extra in extras.split(','))


# --- colcon ------------------------------------------------------------------------------------


@pytest.fixture(scope='module')
def workspace(source: Path) -> Path:
    """Build a colcon workspace that holds this package alone."""
    pytest.importorskip('colcon_ros')
    root = source.parents[1]
    start = 'from colcon_core.command import main; raise SystemExit(main())'
    run_command(sys.executable, '-c', start, '--log-base', root / 'log', 'build', cwd=root)
    return root


@pytest.mark.slow
def test_colcon_installs_what_ros2_run_and_launch_look_for(workspace: Path) -> None:
    prefix = workspace / 'install' / NAME
    for executable in ('monitor', 'stickslip'):
        assert os.access(prefix / 'lib' / NAME / executable, os.X_OK)
    assert (prefix / MARKER).is_file()
    for path in {Path('package.xml')} | list_files('launch_configs'):
        assert (prefix / SHARE / path).read_bytes() == (ROOT / path).read_bytes()
    # `ros2 launch` searches the share by name, and refuses a name that it finds twice.
    assert len(list((prefix / SHARE).rglob('monitor.launch.py'))) == 1


@pytest.mark.slow
def test_installed_command_runs_in_the_sourced_workspace(workspace: Path) -> None:
    print_path = f'{sys.executable} -c "import {NAME}; print({NAME}.__file__)"'
    command = f'install/{NAME}/lib/{NAME}/stickslip --help'
    script = f'. install/setup.sh && {print_path} && {command}'
    printed = run_command('sh', '-c', script, cwd=workspace)
    module_path, _, usage = printed.partition('\n')
    assert Path(module_path).is_relative_to(workspace / 'install')
    assert 'assess' in usage


@pytest.mark.slow
def test_installed_node_comes_up_and_stops_on_ctrl_c(workspace: Path, tmp_path: Path) -> None:
    pytest.importorskip('rclpy')
    # Domains above 100 would need ports that the system may have lent to others.
    apart = {'ROS_DOMAIN_ID': str(1 + os.getpid() % 100), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    prefix = Path('install') / NAME
    config = prefix / SHARE / 'launch_configs' / 'reference_bearing.yaml'
    node = f'. install/setup.sh && exec {prefix}/lib/{NAME}/monitor --ros-args --params-file {config}'
    program = Program(['sh', '-c', node], tmp_path / 'log', cwd=workspace, env=clean_environment(apart))
    try:
        program.until(lambda: 'the monitor is active' in program.output)
        assert program.stop() == 0
    finally:
        program.end()


# --- the launch file ---------------------------------------------------------------------------


class Given:
    """Stands for a `LaunchConfiguration`: its value is what the context, a dict, has."""

    def __init__(self, name: str) -> None:
        self.name = name

    def perform(self, context: dict[str, str]) -> str:
        return context[self.name]

    def __repr__(self) -> str:
        return f'<{self.name}>'


@pytest.fixture
def launch_file(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Load the launch file over stand-ins: `launch` itself is not on PyPI.

    A machine with a ROS 2 installation has it; the tests must say the same everywhere.
    """
    for name in ('launch', 'launch_ros'):
        for part in ('', '.actions', '.substitutions', '.parameter_descriptions'):
            monkeypatch.setitem(sys.modules, f'{name}{part}', MagicMock())
    path = ROOT / 'launch_configs' / 'monitor.launch.py'
    spec: Any = importlib.util.spec_from_file_location('monitor_launch', path)
    module: Any = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.LaunchConfiguration = Given
    module.ParameterValue = lambda value, **_: value
    return module


def test_launch_starts_the_installed_node_with_the_arguments_it_declares(launch_file: Any) -> None:
    launch_file.generate_launch_description()
    node = launch_file.Node.call_args.kwargs
    assert (node['package'], node['executable']) == (NAME, 'monitor')
    declared = [call.args[0] for call in launch_file.DeclareLaunchArgument.call_args_list]
    assert sorted(declared) == ['config', 'enclave', 'log_level', 'namespace', 'respawn', 'use_sim_time']
    assert set(re.findall(r'<(\w+)>', repr(node))) == set(declared)
    # By default a parameter file that is installed.
    launch_file.FindPackageShare.assert_called_with(NAME)
    _, *inside = launch_file.PathJoinSubstitution.call_args.args[0]
    assert Path(*inside) in list_files('launch_configs')


def test_launch_starts_the_program_of_a_wheel(launch_file: Any, tmp_path: Path) -> None:
    # A wheel has no lib/<package>, in which `launch_ros` looks for a package's executables.
    launch_file.IN_WHEEL = tmp_path / 'monitor'
    launch_file.IN_WHEEL.touch()
    launch_file.generate_launch_description()
    node = launch_file.Node.call_args.kwargs
    assert node['executable'] == str(launch_file.IN_WHEEL)
    assert 'package' not in node


def test_launch_refuses_a_missing_parameter_file_and_fails_when_the_monitor_does(
    launch_file: Any, tmp_path: Path
) -> None:
    missing = str(tmp_path / 'missing.yaml')
    with pytest.raises(RuntimeError, match=f"config:='{missing}' is not a file"):
        launch_file.check_config({'config': missing})
    launch_file.check_config({'config': __file__})

    class Context(dict[str, str]):
        """A launch that goes on."""

        is_shutdown = False

    ended = SimpleNamespace(returncode=2)
    with pytest.raises(RuntimeError, match='ended with code 2'):
        launch_file.on_exit(ended, Context(respawn='false'))
    launch_file.on_exit(ended, Context(respawn='true'))
    launch_file.on_exit(SimpleNamespace(returncode=0), Context(respawn='false'))
