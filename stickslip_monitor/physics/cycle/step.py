# SPDX-License-Identifier: Apache-2.0
"""One step of the lining's slip, by Dormand and Prince's method of order 8 with a 5-3 error.

Lengths are in units of ``V/omega`` and times of ``1/omega``, with the displacement ``e`` beyond a
reference point and the relative speed ``z`` beyond a reference speed, so that small motions keep
their digits:

    e' = drift - z        z' = e + offset - 2 zeta z + N/(m omega V) (mu(reference) - mu)

The coefficients are those of E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential
Equations I, 2nd edition, Springer, 1993, section II.5 (DOP853).
"""

from __future__ import annotations

import math
from typing import TypeAlias

from stickslip_monitor.physics.law_numbers import LawNumbers, friction_drop

# V [m/s], N/(m omega V), 2 zeta, offset, reference speed [m/s], mu there, drift
Medium: TypeAlias = tuple[float, float, float, float, float, float, float]


def acceleration(law: LawNumbers, medium: Medium, e: float, z: float) -> float:
    """Rate of the relative speed at a displacement and a relative speed."""
    speed, force, damping, offset, origin, top, _ = medium
    return e + offset - damping * z + force * friction_drop(law, origin, top, speed * z)


def slip_step(
    law: LawNumbers, medium: Medium, e: float, z0: float, r0: float, h: float
) -> tuple[float, float, float, float]:
    """Displacement, relative speed and its rate after a step, and the step's error.

    Args:
        law: The law.
        medium: What the motion takes place in.
        e: Displacement at its begin.
        z0: Relative speed there.
        r0: The rate of that.
        h: Length of the step, negative to go back in time.
    """
    drift = medium[6]
    z1 = z0 + h * (0.05260015195876773 * r0)
    x = e + h * (0.05260015195876773 * drift - (0.05260015195876773 * z0))
    r1 = acceleration(law, medium, x, z1)
    z2 = z0 + h * (0.0197250569845379 * r0 + 0.0591751709536137 * r1)
    x = e + h * (0.0789002279381516 * drift - (0.0197250569845379 * z0 + 0.0591751709536137 * z1))
    r2 = acceleration(law, medium, x, z2)
    z3 = z0 + h * (0.02958758547680685 * r0 + 0.08876275643042054 * r2)
    x = e + h * (
        0.1183503419072274 * drift - (0.02958758547680685 * z0 + 0.08876275643042054 * z2)
    )
    r3 = acceleration(law, medium, x, z3)
    z4 = z0 + h * (0.2413651341592667 * r0 - 0.8845494793282861 * r2 + 0.924834003261792 * r3)
    x = e + h * (
        0.2816496580927726 * drift
        - (0.2413651341592667 * z0 - 0.8845494793282861 * z2 + 0.924834003261792 * z3)
    )
    r4 = acceleration(law, medium, x, z4)
    z5 = z0 + h * (0.037037037037037035 * r0 + 0.17082860872947386 * r3 + 0.12546768756682242 * r4)
    x = e + h * (
        0.3333333333333333 * drift
        - (0.037037037037037035 * z0 + 0.17082860872947386 * z3 + 0.12546768756682242 * z4)
    )
    r5 = acceleration(law, medium, x, z5)
    z6 = z0 + h * (
        0.037109375 * r0 + 0.17025221101954405 * r3 + 0.06021653898045596 * r4 - 0.017578125 * r5
    )
    x = e + h * (
        0.25 * drift
        - (
            0.037109375 * z0
            + 0.17025221101954405 * z3
            + 0.06021653898045596 * z4
            - 0.017578125 * z5
        )
    )
    r6 = acceleration(law, medium, x, z6)
    z7 = z0 + h * (
        0.03709200011850479 * r0
        + 0.17038392571223998 * r3
        + 0.10726203044637328 * r4
        - 0.015319437748624402 * r5
        + 0.008273789163814023 * r6
    )
    x = e + h * (
        0.3076923076923077 * drift
        - (
            0.03709200011850479 * z0
            + 0.17038392571223998 * z3
            + 0.10726203044637328 * z4
            - 0.015319437748624402 * z5
            + 0.008273789163814023 * z6
        )
    )
    r7 = acceleration(law, medium, x, z7)
    z8 = z0 + h * (
        0.6241109587160757 * r0
        - 3.3608926294469414 * r3
        - 0.868219346841726 * r4
        + 27.59209969944671 * r5
        + 20.154067550477894 * r6
        - 43.48988418106996 * r7
    )
    x = e + h * (
        0.6512820512820513 * drift
        - (
            0.6241109587160757 * z0
            - 3.3608926294469414 * z3
            - 0.868219346841726 * z4
            + 27.59209969944671 * z5
            + 20.154067550477894 * z6
            - 43.48988418106996 * z7
        )
    )
    r8 = acceleration(law, medium, x, z8)
    z9 = z0 + h * (
        0.47766253643826434 * r0
        - 2.4881146199716677 * r3
        - 0.590290826836843 * r4
        + 21.230051448181193 * r5
        + 15.279233632882423 * r6
        - 33.28821096898486 * r7
        - 0.020331201708508627 * r8
    )
    x = e + h * (
        0.6 * drift
        - (
            0.47766253643826434 * z0
            - 2.4881146199716677 * z3
            - 0.590290826836843 * z4
            + 21.230051448181193 * z5
            + 15.279233632882423 * z6
            - 33.28821096898486 * z7
            - 0.020331201708508627 * z8
        )
    )
    r9 = acceleration(law, medium, x, z9)
    z10 = z0 + h * (
        -0.9371424300859873 * r0
        + 5.186372428844064 * r3
        + 1.0914373489967295 * r4
        - 8.149787010746927 * r5
        - 18.52006565999696 * r6
        + 22.739487099350505 * r7
        + 2.4936055526796523 * r8
        - 3.0467644718982196 * r9
    )
    x = e + h * (
        0.8571428571428571 * drift
        - (
            -0.9371424300859873 * z0
            + 5.186372428844064 * z3
            + 1.0914373489967295 * z4
            - 8.149787010746927 * z5
            - 18.52006565999696 * z6
            + 22.739487099350505 * z7
            + 2.4936055526796523 * z8
            - 3.0467644718982196 * z9
        )
    )
    r10 = acceleration(law, medium, x, z10)
    z11 = z0 + h * (
        2.273310147516538 * r0
        - 10.53449546673725 * r3
        - 2.0008720582248625 * r4
        - 17.9589318631188 * r5
        + 27.94888452941996 * r6
        - 2.8589982771350235 * r7
        - 8.87285693353063 * r8
        + 12.360567175794303 * r9
        + 0.6433927460157636 * r10
    )
    x = e + h * (
        1.0 * drift
        - (
            2.273310147516538 * z0
            - 10.53449546673725 * z3
            - 2.0008720582248625 * z4
            - 17.9589318631188 * z5
            + 27.94888452941996 * z6
            - 2.8589982771350235 * z7
            - 8.87285693353063 * z8
            + 12.360567175794303 * z9
            + 0.6433927460157636 * z10
        )
    )
    r11 = acceleration(law, medium, x, z11)
    after = z0 + h * (
        0.054293734116568765 * r0
        + 4.450312892752409 * r5
        + 1.8915178993145003 * r6
        - 5.801203960010585 * r7
        + 0.3111643669578199 * r8
        - 0.1521609496625161 * r9
        + 0.20136540080403034 * r10
        + 0.04471061572777259 * r11
    )
    place = e + h * (
        drift
        - (
            0.054293734116568765 * z0
            + 4.450312892752409 * z5
            + 1.8915178993145003 * z6
            - 5.801203960010585 * z7
            + 0.3111643669578199 * z8
            - 0.1521609496625161 * z9
            + 0.20136540080403034 * z10
            + 0.04471061572777259 * z11
        )
    )
    rate = acceleration(law, medium, place, after)
    fifth_z = (
        0.01312004499419488 * r0
        - 1.2251564463762044 * r5
        - 0.4957589496572502 * r6
        + 1.6643771824549864 * r7
        - 0.35032884874997366 * r8
        + 0.3341791187130175 * r9
        + 0.08192320648511571 * r10
        - 0.022355307863886294 * r11
    )
    fifth_e = (
        0.01312004499419488 * z0
        - 1.2251564463762044 * z5
        - 0.4957589496572502 * z6
        + 1.6643771824549864 * z7
        - 0.35032884874997366 * z8
        + 0.3341791187130175 * z9
        + 0.08192320648511571 * z10
        - 0.022355307863886294 * z11
    )
    third_z = (
        -0.18980075407240762 * r0
        + 4.450312892752409 * r5
        + 1.8915178993145003 * r6
        - 5.801203960010585 * r7
        - 0.4226823213237919 * r8
        - 0.1521609496625161 * r9
        + 0.20136540080403034 * r10
        + 0.02265179219836082 * r11
    )
    third_e = (
        -0.18980075407240762 * z0
        + 4.450312892752409 * z5
        + 1.8915178993145003 * z6
        - 5.801203960010585 * z7
        - 0.4226823213237919 * z8
        - 0.1521609496625161 * z9
        + 0.20136540080403034 * z10
        + 0.02265179219836082 * z11
    )
    fifth = max(abs(fifth_z), abs(fifth_e))
    third = max(abs(third_z), abs(third_e))
    scale = math.hypot(fifth, 0.1 * third)
    error = abs(h) * fifth * (fifth / scale) if scale > 0.0 else 0.0
    return place, after, rate, error
