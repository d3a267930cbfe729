"""Rain by other recipes than the data set's, so that networks learn what recipes have in common.

    compositing.py   the values in which rain is mixed with a picture
    fields.py        smooth noise, and planes for half the size
    mist.py          mist of any form and colour, and where drops have wiped it
    shapes.py        outlines and places of drops
    stamps.py        drops on a grid of pixels
    drops.py         what drops show, and how sharp they are
    panes.py         mist and drops together
    lines.py         streaks

Every choice that an author of a generator makes is drawn anew for each pair. All ranges are wide: none is fitted to any
data set. Planes are float32 [H, W].
"""
