# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stickslip_logs.errors import FieldError
from stickslip_logs.field_paths import ByName, NoSuchElementError, NumberField, parse_field

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
    read = NumberField(path).read(MESSAGE)
    assert type(read) is float
    assert read == value


def test_texts_that_are_no_path() -> None:
    wrong = '|.|a.|.a|a..b|a[]|a[-1]|a[1|a]1[|a[1]b|a[1.5]|[0]|1a|_a|__class__|a b| a|a\n|a-b|a/b|a()'
    for text in wrong.split('|'):
        with pytest.raises(FieldError, match='is not a path to a number'):
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
        NumberField(path).read(MESSAGE)


def joint_states(names: list[str], speeds: list[float]) -> SimpleNamespace:
    return SimpleNamespace(name=names, velocity=speeds)


def test_an_element_is_chosen_by_its_name_wherever_it_stands() -> None:
    path = parse_field('velocity[port/shaft.1]')
    assert path == ('velocity', ByName('port/shaft.1'))
    field = NumberField(path)
    assert field.read(joint_states(['port/shaft.1', 'rudder'], [6.0, 0.1])) == 6.0
    assert field.read(joint_states(['rudder', 'port/shaft.1'], [0.1, 7.0])) == 7.0
    with pytest.raises(NoSuchElementError) as error:
        field.read(joint_states(['rudder'], [0.1]))
    assert error.value.names == ('rudder',)


def test_a_place_that_becomes_another_element_is_a_fault() -> None:
    field = NumberField(parse_field('velocity[0]'))
    assert field.read(joint_states(['shaft', 'rudder'], [6.0, 0.1])) == 6.0
    with pytest.raises(LookupError):
        field.read(joint_states(['rudder', 'shaft'], [0.1, 6.0]))
    assert field.read(joint_states(['shaft', 'rudder'], [7.0, 0.1])) == 7.0
