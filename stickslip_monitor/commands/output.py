# SPDX-License-Identifier: Apache-2.0
"""What commands share: arguments, JSON without infinities, the console."""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any

from rich.console import Console


def add_config(parser: argparse.ArgumentParser) -> None:
    """Add ``--config``."""
    parser.add_argument(
        '--config', '-c', required=True, metavar='FILE', help='ROS 2 parameter file'
    )


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add ``--json``."""
    parser.add_argument('--json', action='store_true', help='print JSON, SI units, null for none')


def print_json(document: Any) -> None:
    """Print one JSON document."""
    json.dump(document, sys.stdout, indent=2, allow_nan=False)
    sys.stdout.write('\n')


def console() -> Console:
    """The console for tables; plain text where the output is not a terminal."""
    return Console(highlight=False, soft_wrap=not sys.stdout.isatty())
