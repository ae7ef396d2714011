# SPDX-License-Identifier: Apache-2.0
"""A node as bare as rclpy allows: it publishes each number again. Run by ``benchmarks.node``."""

from __future__ import annotations

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64

TOPICS = ('speed', 'load')


def main() -> None:
    """Spin until interrupted."""
    rclpy.init()
    node = Node('echo')
    best_effort = QoSProfile(depth=500, reliability=ReliabilityPolicy.BEST_EFFORT)
    for topic in TOPICS:
        publisher = node.create_publisher(Float64, f'~/{topic}', 10)
        node.create_subscription(Float64, topic, publisher.publish, best_effort)
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == '__main__':
    main()
