# SPDX-License-Identifier: Apache-2.0
"""Functions with the same bits everywhere: against forty digits, and under other instructions."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys

import mpmath
import numpy as np
import pytest

from stickslip_monitor.lab.scenes.reproducible_math import cos_turns, exp

RANDOM = np.random.default_rng(3)
CODE = """
import numpy as np, hashlib
from stickslip_monitor.lab.scenes.reproducible_math import cos_turns, exp
x = np.random.default_rng(3).uniform(-40.0, 0.0, 20_000)
print(hashlib.sha256(exp(x).tobytes() + cos_turns(x * 1e4).tobytes()).hexdigest())
"""


@pytest.mark.parametrize('reach', [1e-8, 0.4, 30.0, 690.0])
def test_exponential(reach: float) -> None:
    x = np.concatenate([RANDOM.uniform(-reach, reach, 300), [0.0, -0.0, reach, -reach]])
    with mpmath.workdps(40):
        right = np.array([float(mpmath.exp(v)) for v in x.tolist()])
    assert np.all(np.abs(exp(x) - right) <= 1.5 * np.spacing(right))
    assert exp(np.array([0.0, -1e9, -np.inf])).tolist() == [1.0, *[exp(np.array([-700.0]))[0]] * 2]


@pytest.mark.parametrize('reach', [1e-5, 0.3, 10.0, 1e6])
def test_cosine_of_turns(reach: float) -> None:
    x = np.concatenate([RANDOM.uniform(-reach, reach, 300), np.arange(-8, 9) / 8.0])
    with mpmath.workdps(40):
        right = [float(mpmath.cos(2 * mpmath.pi * mpmath.mpf(v))) for v in x.tolist()]
    np.testing.assert_allclose(cos_turns(x), right, rtol=0.0, atol=4e-16)
    assert cos_turns(np.array([0.0, 1.0, -3.0, 0.5, 7.5])).tolist() == [1.0, 1.0, 1.0, -1.0, -1.0]


def test_an_element_does_not_see_its_neighbours() -> None:
    x = RANDOM.uniform(-30.0, 0.0, 999)
    for function in (exp, cos_turns):
        alone = [float(function(x[k : k + 1])[0]) for k in range(x.size)]
        assert alone == function(x).tolist() == function(x[::-1])[::-1].tolist()


def test_other_vector_instructions_give_the_same_bits() -> None:
    """In another process numpy is told to do without those that it finds here."""
    x = np.random.default_rng(3).uniform(-40.0, 0.0, 20_000)
    own = hashlib.sha256(exp(x).tobytes() + cos_turns(x * 1e4).tobytes()).hexdigest()
    found = np.show_config(mode='dicts')['SIMD Extensions'].get('found', [])
    done = subprocess.run(
        [sys.executable, '-W', 'ignore', '-c', CODE],
        env=os.environ | {'NPY_DISABLE_CPU_FEATURES': ' '.join(found)},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.strip() == own
