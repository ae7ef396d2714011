# SPDX-License-Identifier: Apache-2.0
"""Condition monitoring of ships' stern bearings: predicts stick-slip from shaft speed and load."""

from stickslip_monitor.errors import StickslipError
from stickslip_monitor.monitor.assessment import Assessment, Assessments, Outcome, Regime, assess
from stickslip_monitor.monitor.config import MonitorConfig, build_config
from stickslip_monitor.monitor.monitor import Monitor
from stickslip_monitor.monitor.signals import Sample, Stream
from stickslip_monitor.physics.averaging.boundaries import (
    StationaryAmplitudes,
    amplitude_rate,
    fold_load,
    fold_speed,
    growth_rate,
    hopf_load,
    hopf_speed,
    stationary_amplitudes,
)
from stickslip_monitor.physics.cycle.cycles import (
    Cycle,
    CycleKind,
    exact_cycle,
    exact_fold_speed,
    exact_unstable_cycle,
)
from stickslip_monitor.physics.friction import Coulomb, FrictionLaw, Stribeck, Tabulated
from stickslip_monitor.physics.oscillator import Bearing, BearingSpeed

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

__version__ = '0.2.0'
