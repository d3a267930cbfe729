"""Films keep their colours and shape: matrix and range, HDR, pixels that are not square, interlaced frames."""

from fractions import Fraction

import av
import cv2
import numpy as np
import pytest
from painted_room import picture, walking

from hydroviews.captures.video.decoding import open_video, video_frames
from hydroviews.scene.images import to_linear, to_uint8

# Of red, green and blue in luma; what a film is encoded with, told apart from what is decoded.
LUMA = {1: (0.2126, 0.7152, 0.0722), 5: (0.299, 0.587, 0.114), 9: (0.2627, 0.6780, 0.0593)}
BT709, BT601, BT2020 = 1, 5, 9
UNSPECIFIED, LIMITED, FULL = 2, 1, 2
SDR, PQ, HLG = 1, 16, 18
BT2020_FROM_SRGB = np.array([[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]])
PATCHES = np.array([[200, 40, 40], [40, 160, 40], [40, 60, 200], [220, 200, 40], [180, 180, 180], [230, 150, 120]])


def patches(side=16):
    return PATCHES.reshape(2, 3, 3).repeat(side, 0).repeat(side, 1).astype(np.uint8)


def planes(signal, matrix, levels, full):
    """Y, Cb, Cr [3, H, W] of a signal [H, W, 3] in [0, 1]."""
    red, _, blue = LUMA[matrix]
    y = signal @ LUMA[matrix]
    chroma = (signal[..., 2] - y) / (2 * (1 - blue)), (signal[..., 0] - y) / (2 * (1 - red))
    top, unit = levels - 1, levels / 256
    if full:
        values = top * y, *(top * c + levels / 2 for c in chroma)
    else:
        values = unit * (16 + 219 * y), *(unit * (128 + 224 * c) for c in chroma)
    return np.stack([np.clip(value.round(), 0, top) for value in values])


def write_film(path, pictures, matrix=BT709, full=False, tags=None, trc=SDR, codec="ffv1", options=None):
    """A film without loss, encoded by a matrix and a range, whose tags may be others or none."""
    levels = 1024 if trc in (PQ, HLG) else 256
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=10, options=options or {})
        height, width = pictures[0].shape[:2]
        stream.width, stream.height = width, height
        stream.pix_fmt = "yuv444p10le" if levels == 1024 else "yuv444p"
        context = stream.codec_context
        space, span = tags or (matrix, FULL if full else LIMITED)
        context.colorspace, context.color_range, context.color_trc = space, span, trc
        context.color_primaries = BT2020 if matrix == BT2020 else 1
        for i, image in enumerate(pictures):
            signal = image if image.dtype != np.uint8 else image / 255
            stored = planes(signal, matrix, levels, full).astype(np.uint16 if levels == 1024 else np.uint8)
            frame = av.VideoFrame(width, height, stream.pix_fmt)
            for plane, values in zip(frame.planes, stored, strict=True):
                rows = np.zeros((height, plane.line_size // stored.itemsize), stored.dtype)
                rows[:, :width] = values
                plane.update(rows.tobytes())
            frame.colorspace, frame.color_range, frame.color_trc, frame.pts = space, span, trc, i
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def frames_of(path):
    with open_video(path) as video:
        return [frame.pixels for frame in video_frames(video)]


@pytest.mark.parametrize("full", [False, True], ids=["limited", "full"])
@pytest.mark.parametrize("matrix", [BT709, BT601, BT2020])
def test_matrix_and_range_are_as_the_film_says(tmp_path, matrix, full):
    (found,) = frames_of(write_film(tmp_path / "a.mkv", [patches()], matrix, full))
    assert np.abs(found.astype(int) - patches()).max() <= 2


@pytest.mark.parametrize(("side", "matrix"), [(16, BT601), (480, BT709)], ids=["small", "HD"])
def test_where_a_film_does_not_say_its_size_does(tmp_path, side, matrix):
    (found,) = frames_of(write_film(tmp_path / "a.mkv", [patches(side)], matrix, tags=(UNSPECIFIED, 0)))
    assert np.abs(found.astype(int) - patches(side)).max() <= 2


def hdr_signal(image, trc):
    """BT.2100 of an sRGB picture whose white is graphics white."""
    light = to_linear(image) @ BT2020_FROM_SRGB.T
    if trc == PQ:
        y = np.power(203 * light / 10000, 0.1593017578125)
        return np.power((0.8359375 + 18.8515625 * y) / (1 + 18.6875 * y), 78.84375)
    e = 0.265 * light
    a, b, c = 0.17883277, 0.28466892, 0.55991073
    return np.where(e <= 1 / 12, np.sqrt(3 * e), a * np.log(np.maximum(12 * e - b, 1e-9)) + c)


@pytest.mark.parametrize("trc", [PQ, HLG], ids=["PQ", "HLG"])
def test_hdr_is_mapped_to_what_it_looks_like(tmp_path, trc):
    image = picture(walking(3, 9))
    (found,) = frames_of(write_film(tmp_path / "a.mkv", [hdr_signal(image, trc)], BT2020, trc=trc))
    assert -10 * np.log10(((found / 255 - image) ** 2).mean()) > 35


@pytest.mark.parametrize("aspect", [Fraction(4, 3), Fraction(8, 9)])
def test_pixels_that_are_not_square_are_resampled(tmp_path, aspect):
    """As players show the film: the picture of a camera with square pixels."""
    wide = round(96 * aspect)
    exact = picture(walking(3, 9, wide, 64))
    stored = to_uint8(cv2.resize(exact, (96, 64), interpolation=cv2.INTER_AREA))
    options = {"qp": "0", "x264-params": f"sar={aspect.numerator}/{aspect.denominator}"}
    (found,) = frames_of(write_film(tmp_path / "a.mp4", [stored], codec="libx264", options=options))
    assert found.shape == (64, wide, 3)
    assert -10 * np.log10(((found / 255 - exact) ** 2).mean()) > 35


def test_interlaced_frames_are_deinterlaced(tmp_path):
    """A picture that moves sideways, each frame woven of two moments: combs are gone."""
    wide = np.random.default_rng(0).integers(40, 216, (4, 30, 3)).astype(np.uint8).repeat(16, 0).repeat(8, 1)
    progressive = [wide[:, 12 * i : 12 * i + 96] for i in range(8)]
    woven = [frame.copy() for frame in progressive]
    for i, frame in enumerate(woven):
        frame[1::2] = wide[1::2, 12 * i + 6 : 12 * i + 102]
    options = {"flags": "+ildct+ilme", "qp": "0", "x264-params": "tff=1:interlaced=1"}
    found = frames_of(write_film(tmp_path / "a.mp4", woven, codec="libx264", options=options))
    assert len(found) == 8

    def combs(image):
        """Mean difference of each row from those two rows away, over that from the next."""
        return np.abs(np.diff(image.astype(int), axis=0)).mean() / np.abs(image[2:].astype(int) - image[:-2]).mean()

    assert combs(woven[3]) > 2
    assert combs(found[3]) < 1.2
    assert combs(found[3]) < 1.5 * combs(progressive[3])
