# SPDX-License-Identifier: Apache-2.0
"""The laboratory ashore: scenes, the accuracy study, friction from a bench, calibration."""

from stickslip_logs.units import MIB

MAX_TABLE_BYTES = 32 * MIB
"""Largest table beside recordings (curves, reports, profiles), which is read whole: a million rows."""
