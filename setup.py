# SPDX-License-Identifier: Apache-2.0
"""Installs the package for pip and for colcon (build type ament_python)."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = 'stickslip_monitor'
SHARE = Path('share')


def launch_configs():
    """Return (target folder, files) for each folder of launch_configs/, whatever its depth."""
    folders = {}
    for path in sorted(Path('launch_configs').rglob('*')):
        if path.is_file() and '__pycache__' not in path.parts:
            folders.setdefault(str(SHARE / NAME / path.parent), []).append(str(path))
    return sorted(folders.items())


# ROS 2 from PyPI, for machines without a ROS 2 installation (Linux x86-64). The wheels of one
# distribution only fit each other in the versions released together, hence the exact pins.
ROS = [
    'ros-kilted-diagnostic-msgs==5.5.1',
    'ros-kilted-geometry-msgs==5.5.1',
    'ros-kilted-lifecycle-msgs==2.3.0',
    'ros-kilted-rcl-interfaces==2.3.0',
    'ros-kilted-rclpy==9.1.2',
    'ros-kilted-rmw-fastrtps-cpp==9.3.3',
    'ros-kilted-rosgraph-msgs==2.3.0',
    'ros-kilted-sensor-msgs==5.5.1',
    'ros-kilted-std-msgs==5.5.1',
    'ros-kilted-std-srvs==5.5.1',
]

setup(
    name=NAME,
    version='0.4.0.dev0',
    description='Predicts stick-slip vibration of water-lubricated stern bearings (ROS 2, MCAP)',
    license='Apache-2.0',
    maintainer='stickslip_monitor maintainers',
    maintainer_email='maintainers@stickslip-monitor.invalid',
    python_requires='>=3.10',
    packages=find_packages(include=['stickslip_*']),
    package_data={
        'stickslip_logs': ['py.typed', 'recordings/definitions.txt'],
        'stickslip_lab': ['py.typed'],
        NAME: [
            'py.typed',
            'report/page.html',
            'report/page.css',
            'dashboard/page/*',
            'dashboard/page/vendor/*',
            'schemas/*',
        ],
    },
    # The recordings of bags/ stay in the repository: nothing that is installed reads them.
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        *launch_configs(),
    ],
    zip_safe=False,
    install_requires=[
        'argcomplete>=1.12',
        'lz4>=3.1',
        'mcap>=1.1',
        'mcap-ros2-support>=0.5',
        'numba>=0.57',
        'numpy>=1.23',
        'PyYAML>=6.0',
        'rich>=11.2',
        'scipy>=1.9',
        'zstandard>=0.19',  # its frames say where they end
    ],
    extras_require={
        'dashboard': ['aiohttp>=3.9', 'prometheus-client>=0.15'],
        # The docs as a site, with the reference made from docstrings.
        'docs': ['mkdocs>=1.6', 'mkdocstrings[python]>=0.28', 'pymdown-extensions>=10'],
        'ros': ROS,
        # Checks a fleet's recordings on a Dask cluster.
        'fleet': ['distributed>=2024.1'],
        # Signal K and NMEA 0183; with `dashboard` the page, too.
        'links': ['aiohttp>=3.9'],
        # Reads Parquet; the newest wheels need Python 3.11, so that the base does without.
        'logs': ['pyarrow>=12'],
        'report': ['jinja2>=3.0', 'matplotlib>=3.6'],
        # Formerly numba, which is a dependency now: the name stays for whoever installs it.
        'sim': [],
        # colcon runs tests only where it finds pytest here.
        'test': [
            'import-linter>=2.17',
            'axe-core-python>=0.1',
            'colcon-ros',
            'colcon-test-result',
            'distributed>=2024.1',
            'hypothesis>=6.60',
            'mcap>=1.5',  # its writer flushes
            'mpmath>=1.2',
            'pyarrow>=12',
            'pynmeagps>=1.0.40',
            'pytest>=7',
            'pytest-xdist>=3',
            'rosbags>=0.11',  # reads MCAP outside a folder
            'setuptools>=70.1',
        ],
        # What the benchmarks compare with.
        'bench': ['pathsim>=0.20', 'rosbags>=0.11'],
        'lint': ['import-linter>=2.17', 'mypy>=1.13', 'ruff>=0.8', 'scipy-stubs', 'types-PyYAML'],
    },
    entry_points={'console_scripts': [f'monitor = {NAME}.live:main', f'stickslip = {NAME}.__main__:main']},
)
