# SPDX-License-Identifier: Apache-2.0
"""Siconos on the reference bearing at 20 rpm; run by the Python that Debian's package is for.

Usage: siconos_peer.py STEP DURATION. Prints seconds per simulated second and the amplitude [m].
"""

import sys
import time

import numpy as np
import siconos.kernel as sk

MASS, DAMPING, STIFFNESS, LOAD = 50.0, 400.0, 2.0e6, 1000.0
STATIC, KINETIC, DECAY = 0.30, 0.10, 10.0
SPEED = np.pi * 0.1 * 20.0 / 60.0


def main() -> None:
    """Follow the motion: the jump of friction as a relay, what it loses with speed explicitly."""
    step, duration = (float(word) for word in sys.argv[1:])
    start = (STATIC * LOAD - DAMPING * SPEED) / STIFFNESS
    matrix = [[0.0, 1.0], [-STIFFNESS / MASS, -DAMPING / MASS]]
    lining = sk.FirstOrderLinearTIDS([start, SPEED], matrix, [0.0, 0.0])
    relation = sk.FirstOrderLinearTIR([[0.0, 1.0]], [[0.0], [STATIC * LOAD / MASS]])
    relation.setePtr(np.array([-SPEED]))
    contact = sk.Interaction(sk.RelayNSL(1, -1.0, 1.0), relation)
    model = sk.NonSmoothDynamicalSystem(0.0, duration)
    model.insertDynamicalSystem(lining)
    model.link(contact, lining)
    grid = sk.TimeDiscretisation(0.0, step)
    solver = sk.TimeStepping(model, grid, sk.EulerMoreauOSI(0.5), sk.Relay())
    displacements = []
    begin = time.perf_counter()
    while solver.hasNextEvent():
        v = lining.x()[1]
        relative = SPEED - v
        fall = (STATIC - KINETIC) * -np.expm1(-DECAY * abs(relative))
        force = np.array([0.0, -np.sign(relative) * LOAD * fall / MASS])
        lining.setbPtr(force)
        solver.computeOneStep()
        displacements.append(lining.x()[0])
        solver.nextStep()
    spent = time.perf_counter() - begin
    late_part = np.array(displacements[int(0.6 * len(displacements)) :])
    print(spent / duration, 0.5 * np.ptp(late_part))


if __name__ == '__main__':
    main()
