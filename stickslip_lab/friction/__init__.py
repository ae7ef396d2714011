# SPDX-License-Identifier: Apache-2.0
"""Fits the Stribeck law to a measured friction curve."""
