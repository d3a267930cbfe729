"""What water does to light: surfaces, triangles for Blender, light paths baked once, mattes and banks made of them."""
