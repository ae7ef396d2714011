# SPDX-License-Identifier: Apache-2.0
"""``python -m fuzz``: the processes that it starts import the other modules, not this one."""

import sys

from fuzz.run import main

if __name__ == '__main__':
    sys.exit(main())
