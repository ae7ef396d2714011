# SPDX-License-Identifier: Apache-2.0
"""The name under which 0.1 had :mod:`stickslip_monitor.offline.check`; it goes with 1.0."""

import sys
from importlib import import_module

sys.modules[__name__] = import_module('stickslip_monitor.offline.check')
