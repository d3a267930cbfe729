"""The embedded scenes by name."""

from hydroviews.blender.courtyard import COURTYARD
from hydroviews.blender.pieces import Design

DESIGNS: dict[str, Design] = {"courtyard": COURTYARD}
