"""Any method on the clean photographs: `nerf-w+clean` is what `nerf-w` makes of a scene when it does not rain.

Its scores bound what the method could gain by removing rain, and show whether it is a fair opponent without any.
"""

from functools import cache

from baselines.method import Method, named


@cache
def on_clean(method: type[Method]) -> type[Method]:
    """The same method, shown the clean photographs; `3dgs-clean` is `3dgs+clean` by another name."""

    class OnClean(method):  # type: ignore[misc, valid-type]
        trains_on = "clean"
        citation = vars(method).get("citation")

    return named(OnClean, f"{method.__name__}OnClean", f"{method.__name__} on clean photographs.")
