# SPDX-License-Identifier: Apache-2.0
"""Reading recordings: the public names."""

from __future__ import annotations

from .bag import Bag, open_bag
from .values import Cut, Fault, Message, Request, Series, TopicInfo

__all__ = ['Bag', 'Cut', 'Fault', 'Message', 'Request', 'Series', 'TopicInfo', 'open_bag']
