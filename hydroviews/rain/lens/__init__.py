"""Water on the lens, and on a pane in front of it: what stays there while the camera moves.

    effect.py            the effects `raindrop`, `raindrop-renewed`, `raindrop-sharp`: a few large drops
    window.py            the effect `window`: a pane of thousands of small drops
    raindrops.py         a pattern on one scene, prepared for a camera, drawn over views
    severity.py          mist and coverage that a grade needs on a scene
    window_severity.py   beads and mist that a grade needs on a pane
    renewed.py           drops that come and go, from a bank of baked lenses
    lives.py             when each of them does
    patterns/            what is on the glass, one file an ingredient
    optics/              what it does to light: surfaces, meshes, baked light paths

Lengths are sides: the geometric mean of the picture's width and height.
"""
