# SPDX-License-Identifier: Apache-2.0
"""Draws what the laboratory finds."""
