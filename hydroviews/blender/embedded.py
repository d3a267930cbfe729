"""The embedded scenes by name."""

from hydroviews.blender.courtyard import COURTYARD
from hydroviews.blender.pieces import Design
from hydroviews.blender.room import ROOM
from hydroviews.blender.street import STREET

DESIGNS: dict[str, Design] = {"courtyard": COURTYARD, "room": ROOM, "street": STREET}
