"""The embedded scenes: modelled here, rendered by Blender, read like any other capture."""
