"""Light that a photograph clipped, and the light that rain gathers from all around it."""

import cv2
import numpy as np
from numpy.typing import NDArray

from hydroviews.scene.images import luminance, to_linear

Linear = NDArray[np.float32]  # [H, W, 3], linear light

CLIPPED = float(to_linear(np.array([250 / 255], np.float32))[0])  # from here on a photograph says "at least"
BRIGHTEST = 8.0  # radiance given to a fully saturated lamp or sun glint; white paper is 1
LARGEST_LAMP = 0.01  # share of a picture above which saturated pixels are sky or wall, not a lamp
GATHERED_FROM = 0.15  # standard deviation, in picture sides, of the surroundings a falling drop mixes
GREY = 0.75  # share of their colour that they lose in it
LAMP_REACHES = (0.02, 0.06, 0.18)  # the same, of Gaussians whose sum falls off as lamp light does


def air_light(linear: Linear, share: float, tint: float) -> NDArray[np.float32]:
    """The light [3] that mist scatters: as bright as the brightest pixels, and paler.

    Args:
        linear: pixels [N, 3] of linear light.
        share: of the pixels, the brightest, whose mean it is.
        tint: share of their colour that it has.
    """
    brightness = luminance(linear)
    bright = linear[brightness >= np.quantile(brightness, 1 - share)].mean(axis=0)
    return np.asarray(tint * bright + (1 - tint) * luminance(bright), np.float32)


def expand_highlights(linear: Linear) -> Linear:
    """Give saturated pixels back some of the light that the camera could not record.

    A lamp or a glint on metal is many times brighter than white paper, and that is what makes it sparkle in drops
    and streaks. Small saturated areas are taken for lamps, large ones for an overcast sky, which is hardly clipped:
    the gain falls from BRIGHTEST to 1 as the saturated share of the picture rises to ten times LARGEST_LAMP.

    Args:
        linear: [H, W, 3], [0, 1].

    Returns:
        [H, W, 3], [0, BRIGHTEST]; pixels that are not saturated are unchanged.
    """
    peak = linear.max(axis=-1)
    share = float((peak >= CLIPPED).mean())
    if share == 0:
        return linear
    fading = np.clip(np.log10(max(share / LARGEST_LAMP, 1.0)), 0, 1)
    gain = 1 + (BRIGHTEST - 1) * (1 - fading)
    saturation = np.clip((peak - CLIPPED) / (1 - CLIPPED), 0, 1)
    return linear * (1 + (gain - 1) * saturation)[..., None].astype(np.float32)


def rain_light(linear: Linear) -> Linear:
    """The light that falling rain shows in front of each pixel.

    A drop is a lens of about 165 degrees (Garg and Nayar 2007): it shows what lies in a wide cone behind it, most of
    which no picture has. So its brightness follows the surroundings and hardly the pixel it covers; bright
    surroundings count for more (a root mean square), because most of what lies outside the picture and shines into
    the drop is sky; and it is little colourful, because its cone mixes everything. Light beyond white is a lamp's:
    it falls off around the lamp, in its own colour. Beyond the borders the picture is mirrored.

    Args:
        linear: the clean view, [H, W, 3], highlights expanded or not.

    Returns:
        [H, W, 3], linear light. Twice the light gives twice the light as long as no pixel crosses white.
    """
    recorded = np.minimum(linear, np.float32(1))
    around = np.sqrt(_blurred(np.square(recorded), GATHERED_FROM))
    around += GREY * (luminance(around)[..., None] - around)
    lamps = linear - recorded
    if not lamps.any():
        return around
    return np.asarray(around + glow(lamps), np.float32)


def glow(lamps: Linear) -> Linear:
    """The light [H, W, 3] of lamps [H, W, 3], spread around them as it falls off with distance; as much of it."""
    return np.asarray(sum(_blurred(lamps, sides) for sides in LAMP_REACHES) / np.float32(len(LAMP_REACHES)))


def _blurred(picture: Linear, sides: float) -> Linear:
    """Gaussian blur with a standard deviation in picture sides."""
    height, width = picture.shape[:2]
    sigma = sides * float(np.sqrt(height * width))
    shrink = max(1, int(sigma / 4))  # a wide blur needs few pixels
    small = cv2.resize(picture, (-(-width // shrink), -(-height // shrink)), interpolation=cv2.INTER_AREA)
    wide = cv2.GaussianBlur(small.astype(np.float32), (0, 0), sigma / shrink, borderType=cv2.BORDER_REFLECT)
    return np.asarray(cv2.resize(wide, (width, height), interpolation=cv2.INTER_LINEAR), np.float32)
