# SPDX-License-Identifier: Apache-2.0
"""What no ship runs: scenes, the accuracy study, friction from a bench, calibration."""
