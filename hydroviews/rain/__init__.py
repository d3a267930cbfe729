"""Rain: which kinds there are, what one draws on a scene, and the rainy view that results.

    effect.py            what an effect is: the contract that every kind of rain meets
    registry.py          which effects there are, found by name; patterns by name
    patterns.py          a pattern: one rain of an effect, by its number
    scene_statistics.py  what a pattern may know about the scene it rains on
    severity.py          how hard a rain should be for plain 3DGS
    compositing.py       the planes of a layer file, and the equation of water and light
    layers.py            layer files
    light.py             clipped lamps, the light of the air, the light that drops gather
    lens/                drops and mist on the lens       (`raindrop`), on a pane (`window`)
    streaks/             the paper's recipe of streaks    (`streak`)
    storm/               drops in space, seen by all views (`storm`)
    weather/             haze, darkness, night, and all together (`haze`, `dark`, `night`, `shower`)
    other_make/          drops and streaks by other choices (`raindrop-b`, `streak-b`)
    veil.py              what grows with distance and hides what is far

The folders have their effects in `effect.py`, or in files of the effects' names; nothing outside knows an effect by
name.
"""
