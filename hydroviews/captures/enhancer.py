"""The enhancement of rainy photographs before features are detected, which another package registers."""

from hydroviews.captures.sfm.rain import Enhance
from hydroviews.cli.plugins import load_plugin, registered
from hydroviews.errors import InputError

GROUP = "hydroviews.enhancers"  # entry points: functions that enhance a picture, see `estimate_poses`


def find_enhancer() -> Enhance:
    """The registered enhancement of photographs; the first by name, if there are several.

    Raises:
        InputError: no package registers one, or it cannot be imported.
    """
    names = list(registered(GROUP))
    if not names:
        raise InputError("no enhancement of rainy photographs is installed", fix="install HydroViews again")
    found: Enhance = load_plugin(f"enhancement {names[0]}", names[0], GROUP, "enhancement", "function")
    return found
