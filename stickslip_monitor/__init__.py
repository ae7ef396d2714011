# SPDX-License-Identifier: Apache-2.0
"""Condition monitoring of ships' stern bearings: predicts stick-slip from shaft speed and load.

A name is imported when it is first used, so that a command starts without what it does not need.
"""

from importlib import import_module as _import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from stickslip_monitor.errors import StickslipError
    from stickslip_monitor.monitor.assessment import Assessment, Assessments, Outcome, Regime, assess
    from stickslip_monitor.monitor.bearing_monitor import Monitor
    from stickslip_monitor.monitor.configuration import build_config
    from stickslip_monitor.monitor.parameters import MonitorConfig
    from stickslip_monitor.monitor.sample_types import Sample, Stream
    from stickslip_monitor.physics.averaging import (
        StationaryAmplitudes,
        amplitude_rate,
        fold_load,
        fold_speed,
        growth_rate,
        hopf_load,
        hopf_speed,
        stationary_amplitudes,
    )
    from stickslip_monitor.physics.bearing import Bearing, BearingSpeed
    from stickslip_monitor.physics.cycles import (
        Cycle,
        CycleKind,
        exact_cycle,
        exact_fold_speed,
        exact_unstable_cycle,
    )
    from stickslip_monitor.physics.friction import Coulomb, FrictionLaw, Stribeck, Tabulated

__all__ = [
    'Assessment',
    'Assessments',
    'Bearing',
    'BearingSpeed',
    'Coulomb',
    'Cycle',
    'CycleKind',
    'FrictionLaw',
    'Monitor',
    'MonitorConfig',
    'Outcome',
    'Regime',
    'Sample',
    'StationaryAmplitudes',
    'StickslipError',
    'Stream',
    'Stribeck',
    'Tabulated',
    'amplitude_rate',
    'assess',
    'build_config',
    'exact_cycle',
    'exact_fold_speed',
    'exact_unstable_cycle',
    'fold_load',
    'fold_speed',
    'growth_rate',
    'hopf_load',
    'hopf_speed',
    'stationary_amplitudes',
]

__version__ = '0.4.0.dev0'

# Where they are: what others build on comes first, so that little is loaded for a name of physics.
_HOMES = (
    *('errors', 'physics.bearing', 'physics.friction', 'physics.averaging', 'physics.cycles'),
    *('monitor.sample_types', 'monitor.parameters', 'monitor.configuration', 'monitor.assessment'),
    'monitor.bearing_monitor',
)


def __getattr__(name: str) -> Any:
    """Import what a name of :data:`__all__` stands for, when it is first used."""
    if name in __all__:
        for home in _HOMES:
            module = _import_module(f'{__name__}.{home}')
            if hasattr(module, name):
                globals()[name] = getattr(module, name)
                return globals()[name]
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")


def __dir__() -> list[str]:
    """Return the public names, used or not."""
    return sorted({*globals(), *__all__})
