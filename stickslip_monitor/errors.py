# SPDX-License-Identifier: Apache-2.0
"""The errors a caller may want to catch: one root, one subclass for each boundary.

And the parts that their sentences share, and the rules that a quantity of the model must keep.
"""

from __future__ import annotations

import math

from stickslip_logs.errors import (
    BagError,
    FieldError,
    OutputError,
    StickslipError,
    cause,
    did_you_mean,
    plural,
)

__all__ = [
    'AlarmStateError',
    'BagError',
    'CalibrationError',
    'ConfigurationError',
    'DashboardError',
    'DrawingError',
    'FieldError',
    'FitError',
    'FleetError',
    'LinkError',
    'OutputError',
    'PhysicsError',
    'ReportError',
    'RosError',
    'SceneError',
    'StickslipError',
    'cause',
    'did_you_mean',
    'missing_ros_error',
    'plural',
    'program_fault',
    'require_finite',
    'require_not_negative',
    'require_positive',
]


class PhysicsError(StickslipError, ValueError):
    """A model quantity breaks its rule (negative mass, unsorted friction table, ...)."""


class ConfigurationError(StickslipError, ValueError):
    """A configuration file or parameter breaks its rule, or cannot be read."""


class AlarmStateError(StickslipError, ValueError):
    """The saved alarms cannot be read."""


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


def missing_ros_error(error: ImportError) -> RosError:
    """Return the error for a missing ROS 2, to be raised by the caller."""
    return RosError(
        f'ROS 2 is not available ({error}): source its setup file, or install this package with'
        " the extra 'ros'"
    )


def program_fault(error: BaseException) -> str:
    """Return the text for a user on an unexpected error, with how to report it."""
    return (
        f'this is a fault of the program, not of what it was given: {type(error).__name__}:'
        f' {error}. Please report it to its maintainers, with what the same command prints with'
        ' --traceback'
    )


def require_finite(name: str, value: float, unit: str = '') -> None:
    """Raise :class:`PhysicsError` unless the value is a finite number; it is named with its unit.

    >>> require_finite('speed', 0.1, 'm/s')
    """
    if not math.isfinite(value):
        raise PhysicsError(f'{name} = {_show_value(value, unit)} must be a finite number')


def require_positive(name: str, value: float, unit: str = '') -> None:
    """Raise :class:`PhysicsError` unless the value is finite and above zero; it is named with its unit.

    >>> require_positive('mass', 50.0, 'kg')
    """
    require_finite(name, value, unit)
    if not value > 0.0:
        raise PhysicsError(f'{name} = {_show_value(value, unit)} must be greater than 0')


def require_not_negative(name: str, value: float, unit: str = '') -> None:
    """Raise :class:`PhysicsError` unless the value is finite and not below zero; it is named with its unit.

    >>> require_not_negative('damping', 0.0, 'N s/m')
    """
    require_finite(name, value, unit)
    if value < 0.0:
        raise PhysicsError(f'{name} = {_show_value(value, unit)} must not be negative')


def _show_value(value: float, unit: str) -> str:
    """Return a number and its unit, if any, as text."""
    return f'{value:g} {unit}'.rstrip()
