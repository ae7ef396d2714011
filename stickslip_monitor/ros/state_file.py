# SPDX-License-Identifier: Apache-2.0
"""The file that keeps the alarms over a restart: written whole or not at all."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from stickslip_monitor.errors import AlarmStateError, RosError


class StateFile:
    """A JSON document in a file.

    Args:
        path: The file; ``~`` stands for the home folder.

    Raises:
        RosError: Its folder does not exist, or there is a folder of that name.
    """

    def __init__(self, path: str) -> None:
        self.path = Path(path).expanduser()
        if not self.path.parent.is_dir():
            raise RosError(f"state_file = '{path}': there is no folder {self.path.parent}")
        if self.path.is_dir():
            raise RosError(f"state_file = '{path}' must be a file, but is a folder")

    def read(self) -> Any:
        """The document; ``None`` where there is no file yet.

        Raises:
            AlarmStateError: It cannot be read.
        """
        try:
            return json.loads(self.path.read_bytes())
        except FileNotFoundError:
            return None
        except (OSError, ValueError, RecursionError) as error:
            raise AlarmStateError(f'it is not JSON: {error}') from error

    def set_aside(self) -> Path:
        """Rename a damaged file, so that somebody can look at it; return its new name.

        Raises:
            OSError: It cannot be renamed.
        """
        return self.path.replace(self.path.with_name(f'{self.path.name}.damaged'))

    def write(self, document: Any) -> None:
        """Put a new document in the place of the old one.

        Raises:
            OSError: It cannot be written; the old one is untouched.
        """
        new = self.path.with_name(f'{self.path.name}.new')
        with new.open('w', encoding='utf-8') as file:
            json.dump(document, file, indent=1)
            file.flush()
            os.fsync(file.fileno())
        new.replace(self.path)
        _sync_folder(self.path.parent)


def _sync_folder(folder: Path) -> None:
    """Make a rename outlast a loss of power."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
