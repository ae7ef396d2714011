# SPDX-License-Identifier: Apache-2.0
"""Where ``load_config`` stood in 0.2.0: an import path that others have."""

from stickslip_monitor.monitor import parameter_file

load_config = parameter_file.load_config
