# SPDX-License-Identifier: Apache-2.0
"""Finding the recordings of an archive."""

from __future__ import annotations

from pathlib import Path

import pytest
from shared import record

from stickslip_monitor.bags.reader import find_bags, open_bag
from stickslip_monitor.errors import BagError


def make(folder: Path, *names: str) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b'x')


@pytest.fixture
def ship(tmp_path: Path) -> Path:
    make(
        tmp_path,
        'ship/voyage_10/voyage_10_0.mcap',
        'ship/voyage_2/metadata.yaml',
        'ship/voyage_2/voyage_2_0.mcap',
        'ship/2025/may/may_0.mcap',
        'ship/2025/may/deeper/hidden_by_nothing.mcap',
        'ship/clip.mcap',
        'ship/clip_2.mcap',
        'ship/.draft/draft_0.mcap',
        'ship/2025/.half.mcap',
        'ship/README.md',
        'ship/db3/metadata.yaml',
    )
    return tmp_path / 'ship'


def test_a_folder_stands_for_the_recordings_in_it_by_number_not_by_letter(ship: Path) -> None:
    found = [str(bag.relative_to(ship)) for bag in find_bags([ship])]
    assert found == [
        '2025/may',
        '2025/may/deeper/hidden_by_nothing.mcap',
        'clip.mcap',
        'clip_2.mcap',
        'db3',
        'voyage_2',
        'voyage_10',
    ]


def test_recordings_come_in_the_order_in_which_they_are_named_and_once(ship: Path) -> None:
    file = ship / 'voyage_10' / 'voyage_10_0.mcap'
    asked = [ship / 'voyage_10', file, ship / '2025' / '..' / 'voyage_10', ship / 'db3']
    assert find_bags(asked) == [ship / 'voyage_10', file, ship / 'db3']


def test_a_recording_through_a_link_is_the_same_recording(ship: Path) -> None:
    (ship / 'link').symlink_to(ship / 'voyage_2')
    found = find_bags([ship / 'voyage_2', ship / 'link'])
    assert found == [ship / 'voyage_2']


def test_numbered_files_are_one_recording_only_if_they_bear_one_name(tmp_path: Path) -> None:
    make(tmp_path, 'one/a_0.mcap', 'one/a_1.mcap', 'two/a_0.mcap', 'two/b_0.mcap')
    found = [str(bag.relative_to(tmp_path)) for bag in find_bags([tmp_path])]
    assert found == ['one', 'two/a_0.mcap', 'two/b_0.mcap']
    with pytest.raises(BagError, match=r"two' holds 2 recordings: name one of them"):
        open_bag(tmp_path / 'two')


def test_a_link_that_leads_nowhere_is_named_and_the_rest_read(tmp_path: Path) -> None:
    record(tmp_path / 'voyage', {'/a': ([0, 10**9], [1.0, 2.0])})
    (file,) = (tmp_path / 'voyage').glob('*.mcap')
    file.rename(tmp_path / 'b.mcap')
    (tmp_path / 'voyage' / 'metadata.yaml').unlink()
    (tmp_path / 'voyage').rmdir()
    (tmp_path / 'a.mcap').symlink_to('gone.mcap')
    recording = open_bag(tmp_path)
    assert recording.message_count == 2
    assert recording.losses == (
        "file 'a.mcap' was not read: it is a link that leads nowhere, to 'gone.mcap'",
    )
    assert find_bags([tmp_path]) == [tmp_path / 'a.mcap', tmp_path / 'b.mcap']


def test_what_is_none_stays_as_it_is(tmp_path: Path) -> None:
    (tmp_path / 'empty').mkdir()
    asked = [tmp_path / 'nowhere', tmp_path / 'empty']
    assert find_bags(asked) == asked
