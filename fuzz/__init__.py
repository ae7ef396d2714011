# SPDX-License-Identifier: Apache-2.0
"""Hostile recordings: odd ones made on purpose, and mutants, beside MCAP's own reader."""
