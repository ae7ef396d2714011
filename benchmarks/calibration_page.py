# SPDX-License-Identifier: Apache-2.0
"""The results of the study, for the page on calibration."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

MARK = '<!-- What follows is made by `make calibration-study`. -->\n'
_HEAD = (
    'passages', 'fold: error', 'bias', 'half-width', 'cover', 'Hopf: error', 'bias', 'half-width',
    'cover', 'least effective',
)  # fmt: skip


def page(before: str, results: Mapping[str, Any]) -> str:
    """The page with its results made anew; those that there are."""
    parts = [before.partition(MARK)[0] + MARK]
    for name, section in SECTIONS.items():
        if name in results:
            parts.append(section(results[name]))
    return '\n'.join(parts).rstrip() + '\n'


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [f'| {" | ".join(head)} |', f'|{"---|" * len(head)}']
    return '\n'.join([*lines, *(f'| {" | ".join(row)} |' for row in rows), ''])


def _coverage(rows: Sequence[Sequence[Any]]) -> str:
    cells = []
    for name, *values in rows:
        texts = [str(name)]
        for k in (0, 4):
            error, bias, half, cover = values[k : k + 4]
            texts += [f'{error:.1%}', f'{bias:+.1%}', f'{half:.1%}', f'{cover:.0%}']
        cells.append([*texts, f'{values[8]:.0f}'])
    return _table(_HEAD, cells)


def _level(result: Mapping[str, Any]) -> str:
    return (
        f'## Reports of a level: {result["ships"]} ships\n\n'
        'Median error and bias of the posterior median, median half-width of the 90 % interval\n'
        'with the floor, and how often it covers the truth.\n\n' + _coverage(result['rows'])
    )


def _operator(result: Mapping[str, Any]) -> str:
    return (
        f'## Reports of an operator: {result["ships"]} ships\n\n'
        'Times off by up to 5 s and told with 10 s; one report in ten says the opposite; trust'
        ' 0.9.\n\n' + _coverage(result['rows'])
    )


def _reliability(result: Mapping[str, Any]) -> str:
    names = {
        'can': 'stick-slip can happen',
        'will': 'it starts by itself',
        'runs': 'it runs (thresholds)',
    }
    rows = [
        [
            names[name],
            *(f'{said:.2f} -> {was:.2f} ({n})' for said, was, n in found['rows']),
            *([''] * (8 - len(found['rows']))),
            f'{found["brier"]:.4f}',
        ]
        for name, found in result.items()
    ]
    return (
        '## Reliability: what was said, and what was\n\n'
        'Eight ships, calibrated with five passages, then eight passages never seen; seconds in\n'
        'brackets. `runs` goes by thresholds and so begins before the noise has grown: it is for\n'
        'warnings.\n\n' + _table(['', *(['said -> was'] * 8), 'Brier'], rows)
    )


def _three(values: Sequence[float]) -> str:
    return ' - '.join(f'{value:.1f}' for value in values)


def _cases(result: Mapping[str, Any]) -> str:
    rows = [[name, *map(_three, pair)] for name, pair in result.items()]
    return _table(['evidence', 'Hopf [rpm]: 5 - 50 - 95 %', 'fold'], rows)


def _oscillator(result: Mapping[str, Any]) -> str:
    return (
        '## The exact oscillator\n\n'
        "The truth in the package's own recordings, which is that of the event-driven"
        ' integrator:\nHopf 30.74, fold 40.72 rpm at 1 kN. The wrong drawing has damping 40 %'
        ' high, `mu_s - mu_k`\n20 % low and decay 25 % high: by it the Hopf speed is 19.4 and'
        ' the fold 23.9 rpm.\n\n' + _cases(result)
    )


def _failures(result: Mapping[str, Any]) -> str:
    return (
        '## Little evidence\n\nThe reference bearing at 1 kN (30.7 and 40.7 rpm). Quiet bounds the'
        ' Hopf speed, hardly the fold.\n\n' + _cases(result)
    )


def _drift(result: Mapping[str, Any]) -> str:
    return (
        '## A bearing that wears\n\n'
        f'`mu_s - mu_k` rises by 42 % over 24 passages; the last one is judged, {result["ships"]}'
        f' ships.\nThat the bearing may have changed was said, or the result refused, for'
        f' {result["warned"]} of them. The first column\nis `--forget`.\n\n'
        + _coverage(result['rows'])
    )


SECTIONS = {
    'level': _level,
    'operator': _operator,
    'oscillator': _oscillator,
    'failures': _failures,
    'reliability': _reliability,
    'drift': _drift,
}
