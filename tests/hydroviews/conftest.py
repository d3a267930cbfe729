from kept_blender import kept_blender  # noqa: F401
from package_index import package_index  # noqa: F401
from plain_network import plain_network  # noqa: F401
