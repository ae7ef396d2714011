# SPDX-License-Identifier: Apache-2.0
"""Comparisons side by side; ``make bench`` runs them all and writes benchmarks/results.md.

A part is a module with ``run(quick: bool) -> Table``, named in ``benchmarks.parts``.
"""
