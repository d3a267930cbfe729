"""What is on the glass, one file an ingredient: from settings and a generator to bodies of water or planes.

pattern.py   the settings of a wet lens, and the distributions they are drawn from
water.py     drops and droplets, and all water at one moment
runs.py      drops that run down, their trails and beads
mist.py      the veil
shapes.py    outlines of water, triangulated
bodies.py    bodies of water as disks, told apart
"""
