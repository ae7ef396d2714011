# SPDX-License-Identifier: Apache-2.0
"""Estimates the lining's mass, damping and stiffness from what a drawing and a data sheet say.

Each value comes with its formula, its source and its relative standard deviation. What a deviation does to
the fold speed tells what to measure next.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.cycles import end_of_vibration
from stickslip_monitor.physics.friction import Stribeck
from stickslip_monitor.physics.lubrication import Lubrication

DENSITY = {'natural': 920.0, 'nitrile': 1000.0, 'chloroprene': 1230.0}
"""Density of the rubbers without fillers [kg/m^3] (Brydson 1988); fillers add up to a fifth."""
UNSTATED = {
    'hardness': 0.30,  # of the modulus by Gent's formula; one degree of hardness is 5 %
    'length': 0.20,  # of the projected area for the loaded one: an arc of 115 degrees has it, 95 to 140 occur
    'material': 0.20,  # of a density without the fillers
    'loss_factor': 0.30,
    'damping_ratio': 0.10,
    'shear_modulus': 0.15,
    'static': 0.15,
    'kinetic': 0.15,
    'decay': 0.30,
    'load': 0.20,
}
"""Relative standard deviation of a value given without its spread, or of what the first three give: the
scatter of rubber from batch to batch, of ring-downs, of handbook friction, of a load from the alignment."""


MIN_HARDNESS, MAX_HARDNESS = 30.0, 90.0
"""Range of Gent's formula [Shore A]."""
ELSEWHERE = 1.5
"""Ratio assumed between the load of the friction test and that of the ship: as a rule they differ by more."""
LOAD_EXPONENT = 'load_exponent'
"""Name under which :func:`fold_shifts` lists the load exponent: 0 to 1, which only a second curve tells."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value, its relative standard deviation, and where both come from."""

    name: str
    value: float  # SI
    unit: str
    spread: float  # relative standard deviation [-]; 0 for exact
    origin: str  # formula and source


@dataclass(frozen=True, slots=True)
class Given:
    """A value as somebody stated it, in SI, with its relative standard deviation.

    A deviation of nan stands for that of :data:`UNSTATED`.
    """

    value: float
    spread: float = math.nan


@dataclass(frozen=True, slots=True)
class FoldShift:
    """Effect of one standard deviation of a value on the fold speed, as relative changes."""

    name: str
    spread: float
    below: float  # by the value one standard deviation lower; -1 where the fold is lost
    above: float  # by the value one standard deviation higher; inf where only it has a fold

    @property
    def largest(self) -> float:
        """The larger of both in magnitude."""
        return max(abs(self.below), abs(self.above))


def shear_modulus(hardness: float) -> float:
    """Return the shear modulus [Pa] of rubber of a hardness from 30 to 90 [Shore A].

    ``E = 0.0981 (56 + 7.623 S) / (0.1375 (254 - 2.54 S)) MPa`` and ``G = E/3``: Gent, Rubber
    Chemistry and Technology 31 (1958) 896.

    Raises:
        ConfigurationError: The formula does not hold for this hardness.
    """
    if not MIN_HARDNESS <= hardness <= MAX_HARDNESS:
        raise ConfigurationError(
            f'hardness {hardness:g} must be from {MIN_HARDNESS:g} to {MAX_HARDNESS:g} Shore A: beyond them'
            ' give the shear modulus'
        )
    return 0.0981e6 * (56.0 + 7.623 * hardness) / (0.1375 * (254.0 - 2.54 * hardness)) / 3.0


def estimate(given: Mapping[str, Given], material: str = '') -> tuple[Estimate, ...]:
    """Estimate the parameters of the bearing from what is given.

    A value that is given counts more than one that would follow from others.

    Args:
        given: By name, in SI: ``journal_diameter``, ``thickness``; ``length`` or ``area``;
            ``hardness`` or ``shear_modulus``; ``density``, or a material; ``loss_factor`` or
            ``damping_ratio``; ``static``, ``kinetic`` and ``decay`` of the Stribeck law; ``load``.
        material: One of :data:`DENSITY`, where there is no density.

    Returns:
        journal_diameter, mass, damping, stiffness, static, kinetic, decay and load, in this order.

    Raises:
        KeyError: Something is missing, or the material is unknown.
        ConfigurationError: A hardness lies outside the formula.
    """
    values = {name: _stated_estimate(name, item) for name, item in given.items()}
    for derived in _derive_values(values, material):
        values.setdefault(derived.name, derived)
    diameter, thickness, area, modulus, density, ratio = (
        values[name]
        for name in ('journal_diameter', 'thickness', 'area', 'shear_modulus', 'density', 'damping_ratio')
    )
    layer = f'A = {area.value:.3g} m^2 ({area.origin}), h = {1e3 * thickness.value:.3g} mm'
    shear = f'G A/h: G = {modulus.value / 1e6:.3g} MPa ({modulus.origin}), {layer}'
    stiffness = _multiply_estimates(
        ('stiffness', 'N/m', shear), (modulus, 1.0), (area, 1.0), (thickness, -1.0)
    )
    rho = f'rho = {density.value:.4g} kg/m^3 ({density.origin})'
    even = f'rho A h/3, a layer in even shear (Rayleigh): {rho}'
    mass = _multiply_estimates(
        ('mass', 'kg', even), (density, 1.0), (area, 1.0), (thickness, 1.0), times=1.0 / 3.0
    )
    origin = f'2 zeta sqrt(k m): zeta = {ratio.value:.3g} ({ratio.origin})'
    parts = (ratio, 1.0), (area, 1.0), (modulus, 0.5), (density, 0.5)
    damping = _multiply_estimates(('damping', 'N s/m', origin), *parts, times=2.0 / math.sqrt(3.0))
    law = (values[name] for name in ('static', 'kinetic', 'decay'))
    return diameter, mass, damping, stiffness, *law, values['load']


def _stated_estimate(name: str, item: Given) -> Estimate:
    """Return a stated value as an estimate, without a unit.

    A spread that is not stated is that of :data:`UNSTATED`; 0 for a name that is not there.
    """
    spread = UNSTATED.get(name, 0.0) if math.isnan(item.spread) else item.spread
    return Estimate(name, item.value, '', spread, 'ring-down' if name == 'damping_ratio' else 'given')


def _derive_values(values: Mapping[str, Estimate], material: str) -> Iterator[Estimate]:
    """Yield estimates that follow from those given: area, shear modulus, density and damping ratio.

    The area is the projected one, diameter times length. What is stated is yielded again, as derived.
    Of a loss factor ``eta``, ``zeta = eta/2`` at resonance: Nashif, Jones and Henderson, Vibration
    Damping, 1985.

    Args:
        values: The stated estimates, by name.
        material: One of :data:`DENSITY`; '' for none.

    Raises:
        ConfigurationError: A hardness lies outside the formula.
        KeyError: The material is unknown, or a length has no diameter.
    """
    if length := values.get('length'):
        area = values['journal_diameter'].value * length.value
        yield Estimate('area', area, 'm^2', UNSTATED['length'], 'diameter x length')
    if hardness := values.get('hardness'):
        origin = f'Gent 1958, {hardness.value:g} Shore A'
        yield Estimate('shear_modulus', shear_modulus(hardness.value), 'Pa', UNSTATED['hardness'], origin)
    if material:
        origin = f'{material} rubber, Brydson 1988'
        yield Estimate('density', DENSITY[material], 'kg/m^3', UNSTATED['material'], origin)
    if loss := values.get('loss_factor'):
        origin = f'half the loss factor {loss.value:.3g}, Nashif 1985'
        yield Estimate('damping_ratio', 0.5 * loss.value, '-', loss.spread, origin)


def _multiply_estimates(
    texts: tuple[str, str, str], *parts: tuple[Estimate, float], times: float = 1.0
) -> Estimate:
    """Return the product of powers of estimates; their deviations add as those of independent values.

    Args:
        texts: Name, unit and origin of the product.
        parts: Estimates with their powers.
        times: Exact factor.
    """
    name, unit, origin = texts
    value = times * math.prod(factor.value**power for factor, power in parts)
    return Estimate(
        name, value, unit, math.hypot(*(power * factor.spread for factor, power in parts)), origin
    )


def bearing_of(values: Sequence[Estimate]) -> Bearing:
    """Build the bearing, with a Stribeck law, from its estimated values.

    Args:
        values: Estimates [SI] that include ``mass``, ``damping``, ``stiffness``, ``static``, ``kinetic``,
            ``decay`` and ``journal_diameter``; others are ignored.

    Raises:
        KeyError: One of these is missing.
        PhysicsError: A value breaks its rule.
    """
    by_name = {item.name: item.value for item in values}
    return Bearing(
        by_name['mass'],
        by_name['damping'],
        by_name['stiffness'],
        Stribeck(by_name['static'], by_name['kinetic'], by_name['decay']),
        by_name['journal_diameter'],
    )


def fold_shifts(values: Sequence[Estimate]) -> list[FoldShift]:
    """Return the shift of the fold speed by one standard deviation of each value, the largest first.

    The fold is the one that decides, at the mean load. Values that move it by 0.5 % or less are left out;
    :data:`LOAD_EXPONENT` is always listed.

    Args:
        values: As :func:`estimate` returns them.

    Raises:
        PhysicsError: A deviation is so large that one standard deviation lower breaks the value's rule.
    """
    shifts = []
    nominal = _fold_of_values(values)
    for item in values:
        moved = (item.value * (1.0 - item.spread), item.value * (1.0 + item.spread))
        changed = [
            [replace(shifted, value=value) if shifted is item else shifted for shifted in values]
            for value in moved
        ]
        below, above = (_relative_shift(_fold_of_values(shifted), nominal) for shifted in changed)
        if below or above:
            shifts.append(FoldShift(item.name, item.spread, below, above))
    shifts.append(_load_exponent_shift(values, nominal))
    return sorted(shifts, key=lambda effect: -effect.largest)


def _load_exponent_shift(values: Sequence[Estimate], nominal: float) -> FoldShift:
    """Return the shift of the fold by a load exponent of 1, where friction was measured at another load.

    ``below`` is for a test at :data:`ELSEWHERE` times the load, ``above`` for one at its inverse; the spread
    is 0.5, as 0 to 1 is possible. A fold without end counts as none.

    Args:
        values: The estimates.
        nominal: Fold speed with ``g`` 0 [m/s]; 0 for none.
    """
    bearing, load = bearing_of(values), next(item.value for item in values if item.name == 'load')
    ends = []
    for factor in (ELSEWHERE, 1.0 / ELSEWHERE):
        at_other_load = replace(bearing, lubrication=Lubrication(factor * load, 1.0))
        speed = float(end_of_vibration(at_other_load, load))
        ends.append(_relative_shift(speed if math.isfinite(speed) else 0.0, nominal))
    return FoldShift(LOAD_EXPONENT, 0.5, *ends)


def _relative_shift(fold: float, nominal: float) -> float:
    """Return the relative change from ``nominal`` to ``fold`` [both m/s; 0 for none].

    -1 where only ``nominal`` is a fold, ``inf`` where only the other is; 0 where there is neither, or for a
    change up to 0.5 %.
    """
    change = fold / nominal - 1.0 if nominal > 0.0 else math.inf if fold > 0.0 else 0.0
    # Less is not worth a measurement: mass and stiffness move the fold only by what averaging leaves out.
    return change if abs(change) > 5e-3 else 0.0


def _fold_of_values(values: Sequence[Estimate]) -> float:
    """Return the fold speed of estimates at their load [m/s]; 0 where there is none, or it has no end."""
    load = next(item.value for item in values if item.name == 'load')
    speed = float(end_of_vibration(bearing_of(values), load))
    return speed if math.isfinite(speed) else 0.0
