# SPDX-License-Identifier: Apache-2.0
"""A report as one HTML page without network, script or further files."""

from __future__ import annotations

from stickslip_monitor.errors import ReportError
from stickslip_monitor.report.document import Report


def render(report: Report) -> str:
    """The page. Every text is escaped; only the pictures are taken as they are.

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
    return environment.get_template('page.html').render(report=report) + '\n'
