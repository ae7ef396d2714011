# SPDX-License-Identifier: Apache-2.0
"""Reading recordings: the public names."""

from __future__ import annotations

from stickslip_monitor.bags.bag import Bag, open_bag
from stickslip_monitor.bags.values import Cut, Fault, Message, Request, Series, TopicInfo

__all__ = ['Bag', 'Cut', 'Fault', 'Message', 'Request', 'Series', 'TopicInfo', 'open_bag']
