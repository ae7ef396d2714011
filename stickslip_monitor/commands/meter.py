# SPDX-License-Identifier: Apache-2.0
"""Progress on the terminal, for work that lasts long enough to be looked at."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Any

# Until then nothing is shown, and nothing is imported to show it [s].
_PATIENCE = 0.5


class Meter:
    """A progress bar on the standard error, where that is a terminal; a context manager."""

    def __init__(self) -> None:
        self._begin = time.monotonic()
        self._bar: Any = None
        self._wanted = sys.stderr.isatty()

    def __enter__(self) -> Meter:
        """Begin."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Take the bar away."""
        self.hide()

    def show(self, text: str, done: float, total: float | None) -> None:
        """Show how far the work is."""
        if not self._wanted or time.monotonic() - self._begin < _PATIENCE:
            return
        if self._bar is None:
            self._bar = _new_bar()
            self._task = self._bar.add_task('', total=None)
            self._bar.start()
        from rich.markup import escape

        self._bar.update(self._task, description=escape(text), completed=done, total=total)

    def hide(self) -> None:
        """Take the bar away, so that something else can be written."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None


def _new_bar() -> Any:
    from rich.console import Console
    from rich.progress import Progress

    # Else what is printed meanwhile would go the bar's way, to the standard error.
    return Progress(
        console=Console(stderr=True),
        transient=True,
        redirect_stdout=False,
        redirect_stderr=False,
    )
