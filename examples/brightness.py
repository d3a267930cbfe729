"""A whole metric in one file: how much too bright or too dark a render is. Rain that is learned as part of a scene,
mist above all, shows in it first.

Register it in the pyproject.toml of a package of your own, and every record and table has it:

    [project.entry-points."hydroviews.metrics"]
    brightness = "my_package.brightness:BRIGHTNESS"
"""

from torch import Tensor

from hydroviews.metrics import Metric
from hydroviews.metrics.inputs import Mask, Pictures, Score, score_pairs


def brightness_error(image: Pictures, target: Pictures, ignored: Mask | None = None) -> Score:
    """Distance of the means of all shown pixels and channels, in steps of 1/255.

    Args:
        image: [H, W, 3] or [N, 3, H, W], values in [0, 1].
        target: the same shape.
        ignored: bool [H, W] or [N, H, W], true where pixels are hidden.

    Raises:
        ValueError: see `score_pairs`.
    """
    return score_pairs(_brightness_error, image, target, ignored)


def _brightness_error(image: Tensor, target: Tensor, shown: Tensor) -> Tensor:
    """Of batches [N, 3, H, W]; hidden pixels are the same in both, so they do not count in the difference."""
    difference = (image.double() - target.double()).mean(dim=(1, 2, 3))
    return 255 * difference.abs() / shown.double().mean(dim=(1, 2))


BRIGHTNESS = Metric("brightness", "brightness error", 2, higher_is_better=False, function=brightness_error)
