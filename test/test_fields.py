# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.fields import parse_field, read_field

MESSAGE = SimpleNamespace(
    data=2,
    flag=True,
    text='rough',
    velocity=[1.5, -2.5],
    rows=[[1], [4]],
    array=np.array([7, 8], dtype=np.uint8),
    wrench=SimpleNamespace(force=SimpleNamespace(z=-3.25)),
    blades=[SimpleNamespace(pitch=[0.0, 0.25])],
)


@pytest.mark.parametrize(
    ('text', 'path', 'value'),
    [
        ('data', ('data',), 2.0),
        ('flag', ('flag',), 1.0),
        ('velocity[1]', ('velocity', 1), -2.5),
        ('array[0]', ('array', 0), 7.0),
        ('wrench.force.z', ('wrench', 'force', 'z'), -3.25),
        ('rows[1][0]', ('rows', 1, 0), 4.0),
        ('blades[0].pitch[1]', ('blades', 0, 'pitch', 1), 0.25),
    ],
)
def test_paths(text: str, path: tuple[str | int, ...], value: float) -> None:
    assert parse_field(text) == path
    read = read_field(MESSAGE, path)
    assert type(read) is float
    assert read == value


def test_texts_that_are_no_path() -> None:
    wrong = (
        '|.|a.|.a|a..b|a[]|a[-1]|a[1|a]1[|a[1]b|a[1.5]|[0]|1a|_a|__class__|a b| a|a\n|a-b|a/b|a()'
    )
    for text in wrong.split('|'):
        with pytest.raises(ConfigurationError, match='is not a path to a number'):
            parse_field(text)


@pytest.mark.parametrize(
    ('path', 'error'),
    [
        (('velocity', 2), LookupError),
        (('array', 2), LookupError),
        (('nothing',), AttributeError),
        (('data', 'x'), AttributeError),
        (('data', 0), TypeError),
        (('velocity',), TypeError),
        (('wrench',), TypeError),
        (('text',), ValueError),
    ],
)
def test_a_path_that_leads_to_no_number(path: Any, error: type[Exception]) -> None:
    with pytest.raises(error):
        read_field(MESSAGE, path)
