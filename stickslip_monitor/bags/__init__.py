# SPDX-License-Identifier: Apache-2.0
"""Import paths of 0.3 for recordings, kept for one version."""
