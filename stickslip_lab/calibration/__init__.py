# SPDX-License-Identifier: Apache-2.0
"""Infers the boundaries from recordings and reports."""
