"""The way of light through water: surfaces, triangles for Blender, baked light paths, mattes and banks of drops."""
