# SPDX-License-Identifier: Apache-2.0
"""The picture of what is lost against what is false."""

from __future__ import annotations

from pathlib import Path

import pytest

from stickslip_monitor.drawing.canvas import save_figure
from stickslip_monitor.drawing.trade_off import Curve, TradeOff, draw_trade_offs


def test_points_are_where_their_rates_are(tmp_path: Path) -> None:
    pytest.importorskip('matplotlib')
    curve = Curve('delay', ['1', '2', '4'], [100.0, 10.0, 0.0], [0.01, 0.02, 0.05], default=1)
    panel = TradeOff('A', 'false', 'lost', [curve], [('bare', 1000.0, 0.5)])
    figure = draw_trade_offs([panel, panel])
    axes = figure.axes[0]
    line, ring, rule = axes.lines
    assert line.get_xydata().tolist() == [[100.0, 1.0], [10.0, 2.0], [0.0, 5.0]]
    assert ring.get_xydata().tolist() == [[10.0, 2.0]]
    assert rule.get_xydata().tolist() == [[1000.0, 50.0]]
    assert [text.get_text() for text in axes.texts] == ['1', '2', '4', 'bare']
    assert axes.get_xlim()[0] == axes.get_ylim()[0] == 0.0
    save_figure(figure, tmp_path / 'a.png')
    assert (tmp_path / 'a.png').stat().st_size > 1000
