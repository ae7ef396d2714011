# SPDX-License-Identifier: Apache-2.0
"""A report on recordings: one HTML page without network, script or further files, or a picture."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, NamedTuple

from stickslip_monitor import __version__
from stickslip_monitor.drawing.canvas import drawn, heading, sheet, variable
from stickslip_monitor.drawing.palette import CONDITION_NAMES, ON_DARK
from stickslip_monitor.errors import ReportError
from stickslip_monitor.monitor.config import BEARING_PARAMETERS, NODE_PARAMETERS, MonitorConfig
from stickslip_monitor.monitor.config_file import load_parameters
from stickslip_monitor.monitor.messages import number
from stickslip_monitor.monitor.parameter import REQUIRED, Parameter
from stickslip_monitor.report import formatting
from stickslip_monitor.report.recording import RecordingPart
from stickslip_monitor.report.summary import Finding, overall

MOST_EVENTS = 400
_MOST_TOPICS = 100
_MOST_ON_SHEET = 12
_GRADES = {'OK': 'clear', 'WARN': 'warning', 'ERROR': 'alarm'}
_CONDITIONS = {condition.value: name for condition, name in CONDITION_NAMES.items()}
_ORDER = tuple(_GRADES)


class ParameterRow(NamedTuple):
    """One parameter in force; ``given`` is false where it is the default."""

    name: str
    value: str
    unit: str
    given: bool


def html_page(
    parts: Sequence[RecordingPart], config: MonitorConfig, config_path: str, made: datetime
) -> bytes:
    """The page. Every text is escaped; only the pictures are taken as they are.

    Args:
        parts: What is said of each recording.
        config: The configuration.
        config_path: The file it was read from.
        made: The time to be named as that of its making.

    Raises:
        ReportError: Jinja2 is not installed.
    """
    try:
        from jinja2 import Environment, PackageLoader, StrictUndefined
    except ImportError as error:
        raise ReportError(
            f'a report needs Jinja2, which cannot be imported ({error}): install the extra'
            " 'report', e.g. pip install 'stickslip_monitor[report]'"
        ) from error
    environment = Environment(
        loader=PackageLoader('stickslip_monitor.report', '.'),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        name: getattr(formatting, name)
        for name in ('clock', 'count', 'date', 'duration', 'grouped', 'iso', 'minute', 'share')
    } | {'grade': _GRADES.__getitem__, 'condition': _CONDITIONS.__getitem__}
    page = environment.get_template('page.html').render(
        parts=parts,
        finding=_overall(parts),
        made=f'{made.astimezone(timezone.utc):%Y-%m-%d %H:%M} UTC',
        version=__version__,
        shown_events=shown_events,
        most_topics=_MOST_TOPICS,
        is_dated=formatting.is_dated,
        config_path=config_path,
        config_digest=hashlib.sha256(Path(config_path).read_bytes()).hexdigest(),
        parameters=parameter_groups(
            load_parameters(config_path), [bearing.name for bearing in config.bearings]
        ),
        colours={variable(light): (light, dark) for light, dark in ON_DARK.items()},
    )
    return f'{page}\n'.encode(errors='replace')


def png_sheet(parts: Sequence[RecordingPart], path: str) -> bytes:
    """All pictures below each other, of several bearings under the verdict on all of them.

    Raises:
        ReportError: They are more than fit on one picture.
    """
    figures = [figure for part in parts for figure in part.figures]
    if len(figures) > 3 * _MOST_ON_SHEET:
        raise ReportError(
            f"report '{path}': a picture holds {_MOST_ON_SHEET} bearings at most; write a .html"
            ' instead, or fewer bags'
        )
    if sum(len(part.findings) for part in parts) > 1 or not figures:
        verdict = _overall(parts)
        above = heading(f'{verdict.word}: {verdict.sentences[0]}', verdict.sentences[1:])
        figures = [drawn(above), *figures]
    return sheet(figures)


def _overall(parts: Sequence[RecordingPart]) -> Finding:
    return overall([(part.name, finding) for part in parts for finding in part.findings])


def shown_events(events: Sequence[Mapping[str, Any]]) -> list[tuple[int, Mapping[str, Any]]]:
    """The events that a table has room for, with their numbers: the most severe, in order."""
    order = sorted(enumerate(events, 1), key=lambda each: -_ORDER.index(each[1]['level']))
    return sorted(order[:MOST_EVENTS], key=lambda each: each[0])


def parameter_groups(
    values: Mapping[str, Any], bearings: Iterable[str]
) -> list[tuple[str, list[ParameterRow]]]:
    """The parameters in force: those given, and the defaults of the others.

    Args:
        values: The parameters given, by full name.
        bearings: Names of the bearings.

    Returns:
        The heading of each group, and its parameters, those given first.
    """
    groups = [('Monitor', _rows(NODE_PARAMETERS, values, ''))]
    return groups + [
        (f'Bearing {name}', _rows(BEARING_PARAMETERS, values, f'{name}.')) for name in bearings
    ]


def _rows(
    table: Iterable[Parameter], values: Mapping[str, Any], prefix: str
) -> list[ParameterRow]:
    rows = []
    for row in table:
        given = f'{prefix}{row.name}' in values
        value = values.get(f'{prefix}{row.name}', row.default)
        # A number that only another friction law takes has no default.
        if not (value is REQUIRED or value == () or value != value):
            rows.append(ParameterRow(row.name, _value(value), row.unit, given))
    return sorted(rows, key=lambda row: not row.given)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float | int):
        return f'{value:.12g}' if number(float(value)) is not None else 'none'
    if isinstance(value, str):
        return value or '\N{EM DASH}'
    return ', '.join(_value(item) for item in value)
