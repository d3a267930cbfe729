"""Rain of another make: drops and streaks drawn by other choices than `lens` and `streaks`, and by none of their code.

    refraction.py   what a drop on a pane shows, by Snell's and Fresnel's formulas
    drops.py        which drops are on the lens: sizes, shapes, clusters
    lens.py         drops in front of one camera, out of focus
    mist.py         mist of a colour of its own, by its spectrum
    raindrop.py     drops and mist as an effect (`raindrop-b`)
    strokes.py      anti-aliased strokes
    rainfall.py     falling rain in perspective
    streak.py       strokes and a veil as an effect (`streak-b`)
    severity.py     how hard both should be

A result that holds with `raindrop` and not with `raindrop-b` is a result about a generator, not about rain. No method
may know of this folder (`tests/test_layout.py`).
"""
