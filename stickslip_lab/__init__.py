# SPDX-License-Identifier: Apache-2.0
"""What no ship runs: scenes, the accuracy study, friction from a bench, calibration."""

MAX_TABLE_BYTES = 32 << 20
"""Tables beside recordings (curves, reports, profiles) are read whole: this is a million rows."""
