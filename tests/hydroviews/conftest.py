from kept_blender import kept_blender  # noqa: F401
from package_index import package_index  # noqa: F401
