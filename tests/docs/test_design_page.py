"""The picture of the rooms says what the imports say."""

import re

from tests.support.house import BASE, FOUNDATIONS, PLACES, arrow_id, imports, needed
from tests.support.imports import MODULES, room
from tests.support.places import ROOT

PICTURE = ROOT / "docs" / "house.svg"


def test_every_room_stands_in_the_picture():
    text = PICTURE.read_text(encoding="utf-8")
    rooms = {room(module) for module in MODULES} - BASE - {"__init__", "__main__", "cli"}  # these call all others
    assert rooms == {*PLACES} - {FOUNDATIONS}
    assert [name for name in PLACES if f"<!-- {name} -->" not in text] == []


def test_its_arrows_are_the_imports_that_follow_from_no_others():
    drawn = set(re.findall(r'id="(\w+-on-\w+)"', PICTURE.read_text(encoding="utf-8")))
    assert drawn == {arrow_id(above, below) for above, below in needed(imports())}
