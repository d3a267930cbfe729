"""Methods that reconstruct a scene from its views, behind one contract."""
