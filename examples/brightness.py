"""A complete metric in one file: the mean brightness error of a render. Mist that a method takes for part of the scene
raises this error.

Register the metric in the pyproject.toml of your package. Every record and table then has it:

    [project.entry-points."hydroviews.metrics"]
    brightness = "my_package.brightness:BRIGHTNESS"
"""

from torch import Tensor

from hydroviews.metrics import Metric
from hydroviews.metrics.inputs import Mask, Pictures, Score, score_pairs


def brightness_error(image: Pictures, target: Pictures, ignored: Mask | None = None) -> Score:
    """Difference of the mean values over all visible pixels and channels, in steps of 1/255.

    Args:
        image: [H, W, 3] or [N, 3, H, W], values in [0, 1].
        target: the same shape.
        ignored: bool [H, W] or [N, H, W], True at hidden pixels.

    Raises:
        ValueError: see `score_pairs`.
    """
    return score_pairs(_brightness_error, image, target, ignored)


def _brightness_error(image: Tensor, target: Tensor, shown: Tensor) -> Tensor:
    """For batches [N, 3, H, W]; hidden pixels are equal in both, so they do not change the difference."""
    difference = (image.double() - target.double()).mean(dim=(1, 2, 3))
    return 255 * difference.abs() / shown.double().mean(dim=(1, 2))


BRIGHTNESS = Metric("brightness", "brightness error", 2, higher_is_better=False, function=brightness_error)
