# SPDX-License-Identifier: Apache-2.0
"""Starts the monitor: `ros2 launch stickslip_monitor monitor.launch.py`.

The node takes itself through its lifecycle (parameter `autostart`): nothing is driven from here.
A parameter file that is not there, and a monitor that ends with an error, end the launch with one.
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

PACKAGE = 'stickslip_monitor'
# A wheel has the program in bin, where ROS does not look.
IN_WHEEL = Path(__file__).parents[3] / 'bin' / 'monitor'


def check_config(context) -> None:
    """Say now, and in one sentence, that the parameter file is missing."""
    path = LaunchConfiguration('config').perform(context)
    if not Path(path).is_file():
        raise RuntimeError(f"config:='{path}' is not a file: the monitor is not started")


def on_exit(event, context) -> None:
    """End the launch with an error when the monitor does, unless it is started again."""
    respawn = LaunchConfiguration('respawn').perform(context) == 'true'
    if event.returncode and not respawn and not context.is_shutdown:
        raise RuntimeError(f'the monitor ended with code {event.returncode}: nobody monitors')


def program() -> dict[str, str]:
    """Return where the monitor is."""
    if IN_WHEEL.is_file():
        return {'executable': str(IN_WHEEL)}
    return {'package': PACKAGE, 'executable': 'monitor'}


def generate_launch_description() -> LaunchDescription:
    """Return one node and the arguments that differ from ship to ship."""
    reference = PathJoinSubstitution([FindPackageShare(PACKAGE), 'launch_configs', 'reference_bearing.yaml'])
    levels, choice = ['debug', 'info', 'warn', 'error', 'fatal'], ['true', 'false']
    arguments = (
        ('config', reference, 'Parameter file: bearings, inputs and alarm limits', None),
        ('namespace', '', 'ROS namespace of the node', None),
        ('use_sim_time', 'false', 'Take time from /clock, as when a bag is replayed', choice),
        ('log_level', 'info', 'Least severe log message shown', levels),
        ('respawn', 'false', 'Start the monitor again when it ends without being told', choice),
        ('enclave', '/', 'SROS 2 enclave of the node', None),
    )
    given = {name: LaunchConfiguration(name) for name, *_ in arguments}
    use_sim_time = ParameterValue(given['use_sim_time'], value_type=bool)
    node = Node(
        **program(),
        namespace=given['namespace'],
        parameters=[given['config'], {'use_sim_time': use_sim_time}],
        ros_arguments=['--log-level', given['log_level'], '--enclave', given['enclave']],
        respawn=given['respawn'],
        respawn_delay=5.0,
        on_exit=on_exit,
        output='screen',
        emulate_tty=True,
    )
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text, choices=choices)
        for name, default, text, choices in arguments
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=check_config), node])
