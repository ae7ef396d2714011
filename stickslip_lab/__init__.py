# SPDX-License-Identifier: Apache-2.0
"""The laboratory ashore: scenes, the accuracy study, friction from a bench, calibration."""

MAX_TABLE_BYTES = 32 << 20
"""Largest table beside recordings (curves, reports, profiles), which is read whole: a million rows."""
