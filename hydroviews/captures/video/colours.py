"""Frames of films as pictures: what a film says of its colours is followed, and HDR is mapped to what screens show.

| a film says | taken |
|---|---|
| matrix, range | as it says; where it does not, limited, and BT.709 from 720 lines or 1280 columns on, else BT.601 |
| HLG, PQ (BT.2100) | graphics white, 203 cd/m2 or 75 % of HLG, becomes white; brighter light is compressed (BT.2408) |
| primaries of BT.2020 | BT.709's |
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hydroviews.scene.images import to_srgb, to_uint8

if TYPE_CHECKING:
    import av

HD = (1280, 720)  # columns or lines from which a film that does not say is in BT.709
UNSPECIFIED, RGB, BT709, BT601 = 2, 0, 1, 5  # of ffmpeg's matrices
BT2020 = (9, 10)  # its matrices, and primaries
PQ, HLG = 16, 18  # of its transfer functions
FULL, LIMITED = 2, 1  # of its ranges
WHITE_NITS, HLG_WHITE = 203.0, 0.265  # graphics white: light, and scene light of 75 % signal
KNEE = 0.9  # of white, from which on light is compressed
BT709_FROM_BT2020 = np.array(
    [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]], np.float32
)  # BT.2087


def to_pixels(frame: "av.VideoFrame") -> NDArray[np.uint8]:
    """A decoded frame as uint8 [H, W, 3], RGB, sRGB-encoded."""
    options = {} if _is_rgb(frame) else {"src_colorspace": _matrix(frame), "src_color_range": _range(frame)}
    if frame.color_trc in (PQ, HLG):
        signal = frame.reformat(format="rgb48le", dst_color_range=FULL, **options).to_ndarray()
        return tone_mapped(signal.astype(np.float32) / np.float32(65535), int(frame.color_trc))
    return np.asarray(frame.reformat(format="rgb24", dst_color_range=FULL, **options).to_ndarray(), np.uint8)


def _is_rgb(frame: "av.VideoFrame") -> bool:
    return frame.colorspace == RGB or frame.format.is_rgb or frame.format.name.startswith(("pal", "gray", "mono"))


def _matrix(frame: "av.VideoFrame") -> int:
    """The matrix by the film's tag, else by its size; swscale knows one of BT.2020's two."""
    if frame.colorspace in BT2020:
        return BT2020[0]
    if frame.colorspace != UNSPECIFIED:
        return int(frame.colorspace)
    return BT709 if frame.width >= HD[0] or frame.height >= HD[1] else BT601


def _range(frame: "av.VideoFrame") -> int:
    return FULL if frame.color_range == FULL or frame.format.name.startswith("yuvj") else LIMITED


def tone_mapped(signal: NDArray[np.float32], transfer: int) -> NDArray[np.uint8]:
    """An HDR picture for screens that have none.

    Args:
        signal: [H, W, 3] in BT.2020's primaries, encoded by BT.2100, [0, 1].
        transfer: PQ or HLG.
    """
    light = (_pq(signal) / WHITE_NITS if transfer == PQ else _hlg(signal) / HLG_WHITE) @ BT709_FROM_BT2020.T
    over = np.maximum(light - KNEE, 0)
    compressed = np.minimum(light, KNEE) + (1 - KNEE) * (1 - np.exp(-over / (1 - KNEE)))
    return to_uint8(to_srgb(compressed))


def _pq(signal: NDArray[np.float32]) -> NDArray[np.float32]:
    """Light in cd/m2 of a PQ signal (SMPTE ST 2084)."""
    power = np.power(signal, 1 / 78.84375)
    light = np.maximum(power - 0.8359375, 0) / (18.8515625 - 18.6875 * power)
    return np.asarray(10_000 * np.power(light, 1 / 0.1593017578125), np.float32)


def _hlg(signal: NDArray[np.float32]) -> NDArray[np.float32]:
    """Scene light, [0, 1], of an HLG signal (BT.2100)."""
    a, b, c = 0.17883277, 0.28466892, 0.55991073
    return np.asarray(np.where(signal <= 0.5, signal**2 / 3, (np.exp((signal - c) / a) + b) / 12), np.float32)
