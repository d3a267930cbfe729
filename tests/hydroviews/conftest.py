from kept_blender import kept_blender  # noqa: F401
