"""Lenses against their flat pictures: how much of the photographs is left after undistortion."""

from hydroviews.scene.lenses import kept_share
from hydroviews.scene.scenes import Scene

LITTLE = 0.5  # share of a photograph below which that is told
LENSES = 20  # that are looked at


def left_after_undistortion(scene: Scene) -> list[str]:
    """A sentence where undistortion leaves less than half of a photograph."""
    lenses = list(dict.fromkeys(view.lens for view in scene.views if view.lens is not None))[:LENSES]
    shares = {lens: kept_share(lens) for lens in lenses}
    least = min(shares, key=shares.__getitem__, default=None)
    if least is None or shares[least] >= LITTLE:
        return []
    size = least.pinhole()
    return [
        f"{scene.name}: {shares[least]:.0%} of the photograph is left after undistortion ({least.called}, flat "
        f"{size.width}x{size.height}): a flat picture has no room for the rest; cut several perspective pictures out "
        "of such photographs to keep more"
    ]
