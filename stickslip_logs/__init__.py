# SPDX-License-Identifier: Apache-2.0
"""Reads and writes recordings and logs of any format; knows nothing of bearings."""
