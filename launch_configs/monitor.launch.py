# SPDX-License-Identifier: Apache-2.0
"""Starts the monitor: `ros2 launch stickslip_monitor monitor.launch.py`.

The node takes itself through its lifecycle (parameter `autostart`): nothing is driven from here.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

PACKAGE = 'stickslip_monitor'


def generate_launch_description() -> LaunchDescription:
    """Return one node and the four arguments that differ from ship to ship."""
    reference = PathJoinSubstitution(
        [FindPackageShare(PACKAGE), 'launch_configs', 'reference_bearing.yaml']
    )
    use_sim_time = ParameterValue(LaunchConfiguration('use_sim_time'), value_type=bool)
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'config',
                default_value=reference,
                description='Parameter file: bearings, inputs and alarm limits',
            ),
            DeclareLaunchArgument(
                'namespace', default_value='', description='ROS namespace of the node'
            ),
            DeclareLaunchArgument(
                'use_sim_time',
                default_value='false',
                choices=['true', 'false'],
                description='Take time from /clock, as when a bag is replayed',
            ),
            DeclareLaunchArgument(
                'log_level',
                default_value='info',
                choices=['debug', 'info', 'warn', 'error', 'fatal'],
                description='Least severe log message shown',
            ),
            Node(
                package=PACKAGE,
                executable='monitor',
                namespace=LaunchConfiguration('namespace'),
                parameters=[LaunchConfiguration('config'), {'use_sim_time': use_sim_time}],
                ros_arguments=['--log-level', LaunchConfiguration('log_level')],
                output='screen',
                emulate_tty=True,
            ),
        ]
    )
