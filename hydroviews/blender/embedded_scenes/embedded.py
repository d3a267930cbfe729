"""The embedded scenes by name."""

from hydroviews.blender.embedded_scenes.courtyard import COURTYARD
from hydroviews.blender.embedded_scenes.market import MARKET
from hydroviews.blender.embedded_scenes.pieces import Design
from hydroviews.blender.embedded_scenes.pond import POND
from hydroviews.blender.embedded_scenes.room import ROOM
from hydroviews.blender.embedded_scenes.street import STREET

DESIGNS: dict[str, Design] = {"courtyard": COURTYARD, "room": ROOM, "street": STREET, "pond": POND, "market": MARKET}
