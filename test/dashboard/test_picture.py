# SPDX-License-Identifier: Apache-2.0
"""The first picture of the README against the program as it is."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from shared import CONFIG

from stickslip_monitor.cli import main

ROOT = Path(__file__).resolve().parents[2]


def test_the_picture_says_what_the_program_says(capsys: pytest.CaptureFixture[str]) -> None:
    """Where this fails, `python scripts/make_pictures.py` takes the picture again."""
    image: Any = pytest.importorskip('PIL.Image')
    with image.open(ROOT / 'docs/images/dashboard.png') as picture:
        shown = json.loads(picture.text['Description'])
    main(['check', str(ROOT / 'bags/coast_down'), '-c', str(CONFIG), '--json'])
    (bearing,) = json.loads(capsys.readouterr().out)['bearings'].values()
    told = [event['text'] for event in bearing['events']]
    assert len(shown) == 3
    for text in shown:
        assert any(each.endswith(text) for each in told), (text, told)
