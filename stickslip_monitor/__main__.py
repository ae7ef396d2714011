# SPDX-License-Identifier: Apache-2.0
"""``python -m stickslip_monitor`` is the command ``stickslip``."""

import importlib
import sys

from stickslip_monitor import interruption


def main() -> int:
    """Run the command line, which is imported only when signals are handled; return the exit code.

    Raises:
        SystemExit: The help or the version was printed.
    """
    interruption.end_at_once()
    code: int = importlib.import_module('stickslip_monitor.cli').main()
    return code


if __name__ == '__main__':
    sys.exit(main())
