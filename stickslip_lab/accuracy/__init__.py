# SPDX-License-Identifier: Apache-2.0
"""Measures what accuracy costs."""
