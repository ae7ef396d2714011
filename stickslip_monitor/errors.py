# SPDX-License-Identifier: Apache-2.0
"""The errors a caller may want to catch: one root, one subclass for each boundary.

And the parts that their sentences share, and the rules that a quantity of the model must keep.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable


class StickslipError(Exception):
    """Root of every error this package raises on purpose; its text is one sentence for a user."""


class PhysicsError(StickslipError, ValueError):
    """A model quantity breaks its rule (negative mass, unsorted friction table, ...)."""


class ConfigurationError(StickslipError, ValueError):
    """A configuration file or parameter breaks its rule, or cannot be read."""


class AlarmStateError(StickslipError, ValueError):
    """What was kept of the alarms over a restart cannot be read."""


class BagError(StickslipError):
    """A recording cannot be opened, read or written."""


class SceneError(StickslipError, ValueError):
    """A scene file breaks its rule, or cannot be read."""


class CalibrationError(StickslipError, ValueError):
    """Evidence or a result of a calibration cannot be read, or is not enough."""


class FitError(StickslipError, ValueError):
    """A measured friction curve cannot be read, breaks its rule, or cannot identify the law."""


class RosError(StickslipError):
    """The ROS 2 side cannot do what was asked (missing installation, unknown message type)."""


class DrawingError(StickslipError):
    """A picture or table cannot be drawn or written."""


class ReportError(StickslipError):
    """A report cannot be made or written."""


class DashboardError(StickslipError):
    """The dashboard cannot be served, or cannot do what was asked."""


class FleetError(StickslipError):
    """A cluster cannot be reached, is lost, or cannot do what was asked."""


class LinkError(StickslipError):
    """One of the ship's buses cannot be used as configured."""


class OutputError(StickslipError):
    """An output is an input, or would replace a file that this package did not write."""


def plural(number: int, what: str) -> str:
    """A number with its noun: ``0 events``, ``1 event``, ``1250 events``."""
    return f'{number} {what}{"" if number == 1 else "s"}'


def did_you_mean(given: object, known: Iterable[str]) -> str:
    """The end of a sentence on an unknown name: ``; did you mean 'x'?``, empty if none is near."""
    text, names = str(given), list(known)
    # The dashes of options make no two of them alike.
    bare = {name.lstrip('-'): name for name in names}
    close = difflib.get_close_matches(text.lstrip('-'), bare, n=1, cutoff=0.65)
    close = [bare[name] for name in close] or [name for name in names if len(text) > 1 and text in name]
    return f"; did you mean '{close[0]}'?" if close else ''


def no_ros(error: ImportError) -> RosError:
    """The error where ROS 2 is needed and cannot be imported."""
    return RosError(
        f'ROS 2 is not available ({error}): source its setup file, or install this package with'
        " the extra 'ros'"
    )


def cause(error: BaseException) -> str:
    """Why something failed, without the number or the place in C that the system has for it."""
    text = getattr(error, 'strerror', None) or str(error) or type(error).__name__
    return re.sub(r'^\[SSL: \w+\] (.*) \(_ssl\.c:\d+\)$', r'TLS: \1', text)


def program_fault(error: BaseException) -> str:
    """The text for a user of an error that is raised by mistake and not on purpose."""
    return (
        f'this is a fault of the program, not of what it was given: {type(error).__name__}:'
        f' {error}. Please report it to its maintainers, with what the same command prints with'
        ' --traceback'
    )


def require_finite(name: str, value: float, unit: str = '') -> None:
    """Raise :class:`PhysicsError` unless the value is a finite number.

    >>> require_finite('speed', 0.1, 'm/s')
    """
    if not math.isfinite(value):
        raise PhysicsError(f'{name} = {_shown(value, unit)} must be a finite number')


def require_positive(name: str, value: float, unit: str = '') -> None:
    """Raise :class:`PhysicsError` unless the value is finite and above zero.

    >>> require_positive('mass', 50.0, 'kg')
    """
    require_finite(name, value, unit)
    if not value > 0.0:
        raise PhysicsError(f'{name} = {_shown(value, unit)} must be greater than 0')


def require_not_negative(name: str, value: float, unit: str = '') -> None:
    """Raise :class:`PhysicsError` unless the value is finite and not below zero.

    >>> require_not_negative('damping', 0.0, 'N s/m')
    """
    require_finite(name, value, unit)
    if value < 0.0:
        raise PhysicsError(f'{name} = {_shown(value, unit)} must not be negative')


def _shown(value: float, unit: str) -> str:
    return f'{value:g} {unit}'.rstrip()
