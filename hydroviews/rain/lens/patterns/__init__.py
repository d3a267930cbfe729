"""Ingredients of a wet glass, one file each: functions from settings and a generator to bodies of water or planes.

    pattern.py   the settings of a wet lens, and the distributions they are drawn from
    window.py    the same of a wet pane
    water.py     larger drops and droplets, and all water at one moment
    beads.py     small drops of a pane, by the thousand
    film.py      bands of water film on a pane
    runs.py      drops that run down, their trails and what they leave
    mist.py      the veil
    shapes.py    outlines of water, triangulated
    bodies.py    bodies of water as disks, told apart
    fields.py    smooth random fields

Lengths are sides: the geometric mean of the picture's width and height.
"""
