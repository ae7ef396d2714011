# SPDX-License-Identifier: Apache-2.0
"""The rules that a quantity of the model must keep: one sentence with name, value and rule."""

from __future__ import annotations

import math

from stickslip_monitor.errors import PhysicsError


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
