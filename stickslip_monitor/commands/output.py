# SPDX-License-Identifier: Apache-2.0
"""What commands share: arguments, JSON without infinities, the console."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_monitor.errors import ReportError

if TYPE_CHECKING:
    from rich.console import Console


def add_config(parser: argparse.ArgumentParser) -> None:
    """Add ``--config``."""
    parser.add_argument(
        '--config', '-c', required=True, metavar='FILE', help='ROS 2 parameter file'
    )


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add ``--json``."""
    parser.add_argument('--json', action='store_true', help='print JSON, SI units, null for none')


def json_text(document: Any) -> str:
    """One JSON document as text that ends its last line."""
    return json.dumps(document, indent=2, allow_nan=False) + '\n'


def print_json(document: Any) -> None:
    """Print one JSON document."""
    sys.stdout.write(json_text(document))


def write_whole(path: Path, data: bytes) -> None:
    """Write a file under its name only when all of it is written; one that is there is replaced.

    Raises:
        ReportError: It cannot be written; what was there stays.
    """
    draft = None
    try:
        number, draft = tempfile.mkstemp(prefix=f'.{path.name}.', dir=path.parent)
        with os.fdopen(number, 'wb') as file:
            file.write(data)
        # mkstemp lets nobody else read; a report is a file as any other.
        mask = os.umask(0)
        os.umask(mask)
        Path(draft).chmod(0o666 & ~mask)
        Path(draft).replace(path)
    except OSError as error:
        raise ReportError(f"'{path}' cannot be written: {error.strerror or error}") from error
    finally:
        if draft is not None:
            with contextlib.suppress(OSError):
                Path(draft).unlink(missing_ok=True)


def console() -> Console:
    """The console for tables; plain text where the output is not a terminal."""
    from rich.console import Console  # costs time to import, and not every command prints with it

    return Console(highlight=False, soft_wrap=not sys.stdout.isatty())
