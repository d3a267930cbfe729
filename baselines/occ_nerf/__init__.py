"""Occlusion-free NeRF: a field of everything, a field of the scene behind, and a detector that parts them by depth."""
