# SPDX-License-Identifier: Apache-2.0
"""Declares units, each once, with the quantity that it measures, its factor and its spellings.

Options, configuration, scenes, logs and buses take their units from here: one more unit is one more row of
:data:`UNITS`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

SECOND_NS = 1_000_000_000
"""A second [ns]."""
KIB = 1024
"""A kibibyte [bytes]."""
MIB = KIB * KIB
"""A mebibyte [bytes]."""


class Unit(NamedTuple):
    """A unit of a quantity: ``SI value = number * factor / divisor + zero``.

    A unit of turning gives, of a journal of 1 m diameter, the surface speed [m/s].
    """

    quantity: str
    name: str  # as configuration, options and reports write it
    factor: float = 1.0  # that of the SI unit
    # As logs write it, parted by blanks; one in small letters stands for any case. None: not read in logs.
    spellings: str = ''
    # As logs write it too, but something else where no word of the quantity stands beside it.
    beside_quantity: str = ''
    divisor: float = 1.0
    zero: float = 0.0  # the SI value of 0


UNITS = (
    Unit('turning', 'rpm', math.pi, 'rpm r.p.m. r/min 1/min rev/min min-1 min⁻¹ u/min tr/min', divisor=60.0),
    Unit('turning', 'rad/s', spellings='rad/s rad/sec rads-1', divisor=2.0),
    Unit('turning', 'Hz', math.pi, 'hz 1/s s-1 s⁻¹ rev/s r/s rps'),
    Unit('speed', 'm/s', spellings='m/s ms-1'),
    Unit('speed', 'mm/s', 1e-3, 'mm/s mms-1'),
    Unit('speed', 'cm/s', 1e-2, 'cm/s cms-1'),
    Unit('speed', 'um/s', 1e-6, 'um/s µm/s μm/s'),
    Unit('force', 'N', spellings='n'),
    Unit('force', 'kN', 1e3, 'kn'),
    Unit('force', 'MN', 1e6, 'MN'),
    Unit('force', 'tf', 9806.65, 'tf t-f tonne-force'),
    Unit('force', 't', 9806.65, beside_quantity='t tonne tonnes'),
    Unit('force', 'lbf', 4.4482216152605, 'lbf lb-f'),
    Unit('acceleration', 'm/s^2', spellings='m/s2 m/s²'),
    Unit('acceleration', 'g', 9.80665, 'g'),
    Unit('length', 'mm', 1e-3),
    Unit('length', 'm'),
    Unit('length', 'um', 1e-6, 'um µm μm'),
    Unit('area', 'm2'),
    Unit('area', 'cm2', 1e-4),
    Unit('pressure', 'Pa', spellings='pa'),
    Unit('pressure', 'MPa', 1e6),
    Unit('voltage', 'V', spellings='v'),
    Unit('ratio', 'dB', spellings='db'),
    Unit('coefficient', '1', beside_quantity='1 - n/n'),
    Unit('coefficient', '%', 1e-2, beside_quantity='% percent'),
    Unit('temperature', 'C', beside_quantity='c °c ℃ degc celsius', zero=273.15),
    Unit('temperature', 'K', beside_quantity='k degk kelvin'),
    Unit('temperature', 'F', 5.0, beside_quantity='f °f ℉ degf fahrenheit', divisor=9.0, zero=459.67 / 1.8),
)
# Between the parts of a unit, as in 'm s^-1' and 'm⋅s-1'.
_JOINERS = dict.fromkeys(map(ord, '^·⋅'))
_BY_NAME = {unit.name: unit for unit in UNITS}
_BY_SPELLING = {text.translate(_JOINERS): unit for unit in UNITS for text in unit.spellings.split()}
_BESIDE_QUANTITY = {(unit.quantity, text): unit for unit in UNITS for text in unit.beside_quantity.split()}


def names_of(quantity: str) -> tuple[str, ...]:
    """Return the names of the units of a quantity, in the order of the table; empty for an unknown one."""
    return tuple(unit.name for unit in UNITS if unit.quantity == quantity)


def factors_of(*names: str) -> dict[str, float]:
    """Return the factor from each unit to that of SI, by name; the zero of temperatures is not in it.

    Raises:
        KeyError: A name is not that of a unit.

    >>> factors_of('kN', 'mm')
    {'kN': 1000.0, 'mm': 0.001}
    """
    return {name: _BY_NAME[name].factor / _BY_NAME[name].divisor for name in names}


def affine_conversion(name: str, target: str) -> tuple[float, float] | None:
    """Return factor and summand that convert a number in one unit to another unit: ``n * factor + summand``.

    None where the units measure different quantities, or a name is not that of a unit.

    >>> affine_conversion('kN', 'N')
    (1000.0, 0.0)
    >>> affine_conversion('C', 'K')
    (1.0, 273.15)
    """
    source, to = _BY_NAME.get(name), _BY_NAME.get(target)
    if source is None or to is None or source.quantity != to.quantity:
        return None
    ratio = source.factor * to.divisor / (source.divisor * to.factor)
    return ratio, (source.zero - to.zero) * to.divisor / to.factor


def conversion(name: str, target: str) -> float | None:
    """Return the factor that converts one unit to another; None where no factor alone does.

    So also for a name that is not that of a unit.

    >>> conversion('kN', 'N')
    1000.0
    """
    ratio, shift = affine_conversion(name, target) or (None, 0.0)
    return ratio if shift == 0.0 else None


def turning_factor(name: str, diameter: float) -> float:
    """Return the surface speed [m/s] of a journal of a diameter [m] that turns at one of a unit of turning.

    Raises:
        KeyError: The name is not that of a unit.

    >>> turning_factor('rad/s', 0.5)
    0.25
    """
    unit = _BY_NAME[name]
    return unit.factor * diameter / unit.divisor


def find_unit(text: str, quantity: str = '') -> Unit | None:
    """Return the unit that a text spells, as ``'[kN]'`` or ``'r / min'``; None for any other text.

    It is read as written, else in lower case. Some, such as 'C' or '%', count only beside their quantity.

    >>> find_unit('[U/min]').name
    'rpm'
    """
    plain = ''.join(text.strip(' []()').translate(_JOINERS).split())
    for form in (plain, plain.lower()):
        if unit := _BY_SPELLING.get(form) or _BESIDE_QUANTITY.get((quantity, form)):
            return unit
    return None


def conversion_from_text(text: str, target: str) -> float | None:
    """Return the factor from the unit that a text spells to another; None where it spells no such unit.

    Raises:
        KeyError: ``target`` is not the name of a unit.

    >>> conversion_from_text('r/min', 'Hz') == 1 / 60
    True
    """
    unit = find_unit(text, _BY_NAME[target].quantity)
    return None if unit is None else conversion(unit.name, target)
