# SPDX-License-Identifier: Apache-2.0
"""Makes recordings of scenes, with the truth about the lining."""
