# SPDX-License-Identifier: Apache-2.0
"""The executable ``monitor``: the node, and what other adapters do for it.

Adapters do not know each other. The node hands its clips to whoever can write them; that it is the
bag layer, and so MCAP, is named here and nowhere else.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from stickslip_monitor import jit
from stickslip_monitor.errors import missing_ros_error
from stickslip_monitor.monitor.clip_recorder import ClipStore
from stickslip_monitor.monitor.parameters import ClipConfig


def clip_store(config: ClipConfig) -> ClipStore:
    """Return the folder of a configuration as the store of a node's clips; it is made if needed.

    Raises:
        BagError: The folder cannot be made or read, or an old draft cannot be removed.
    """
    # Not needed, and not loaded, where no clips are wanted.
    from stickslip_monitor.offline.clip_folder import ClipFolder

    return ClipFolder(config)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node, without loading numba, until it is to stop; return its exit code.

    2 where ROS 2 is missing, which is printed; else that of :func:`stickslip_monitor.ros.process.main`, which
    takes ``args``.
    """
    try:
        from stickslip_monitor.ros import process
    except ImportError as error:
        print(f'ERROR: {missing_ros_error(error)}', file=sys.stderr)  # noqa: T201
        return 2
    with jit.interpreted():
        return process.main(args, clip_store)


if __name__ == '__main__':
    sys.exit(main())
