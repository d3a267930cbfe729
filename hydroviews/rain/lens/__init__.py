"""Water on the lens: drops, rivulets and mist that stay there while the camera moves.

effect.py      the effects: `raindrop`, `raindrop-renewed`, `raindrop-sharp`
raindrops.py   a pattern on one scene, prepared for a camera, drawn over views
severity.py    mist and coverage that a grade needs on a scene
renewed.py     drops that come and go, from a bank of baked lenses; lives.py: when each does
patterns/      what is on the glass, one file an ingredient
optics/        what it does to light: surfaces, meshes, baked light paths
"""
