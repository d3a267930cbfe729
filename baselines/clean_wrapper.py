"""Any method on the clean photographs: `nerf-w+clean` is what `nerf-w` makes of a scene when it does not rain.

Its scores bound what the method could gain by removing rain, and show whether it is a fair opponent without any.
"""

from functools import cache

from baselines.method import Method


@cache
def on_clean(method: type[Method]) -> type[Method]:
    """The same method, shown the clean photographs; `3dgs-clean` is `3dgs+clean` by another name."""
    about = {"__module__": __name__, "__doc__": f"{method.__name__} on clean photographs.", "trains_on": "clean"}
    return type(f"{method.__name__}OnClean", (method,), about)
