import tracemalloc

import cv2
import numpy as np
import pycolmap
import pytest
from distorted import LENS, colmap_capture, colours, photograph

from hydroviews.dataset.build import build
from hydroviews.errors import InputError
from hydroviews.formats.checks.undistortion import left_after_undistortion
from hydroviews.formats.read import read_scene
from hydroviews.scene import lenses
from hydroviews.scene.cameras import fitted_size
from hydroviews.scene.depth import write_depth
from hydroviews.scene.images import read_image, resize_area, to_uint8, write_png
from hydroviews.scene.lenses import Lens, kept_share
from hydroviews.scene.scenes import View, make_scene, no_points

FISHEYE = (60.0, 61.0, 48.0, 35.0)
LENSES = [
    Lens("SIMPLE_RADIAL", 96, 72, (80.0, 48.0, 36.0, -0.1)),
    Lens("RADIAL", 96, 72, (80.0, 47.0, 37.0, 0.1, -0.05)),
    LENS,
    Lens("FULL_OPENCV", 96, 72, (80.0, 82.0, 47.0, 37.0, -0.1, 0.02, 0.001, -0.001, 0.01, 0.02, 0.01, 0.0)),
    Lens("FOV", 96, 72, (80.0, 82.0, 47.0, 37.0, 0.5)),
    Lens("OPENCV_FISHEYE", 96, 72, (*FISHEYE, 0.02, -0.01, 0.002, 0.0)),
    Lens("SIMPLE_RADIAL_FISHEYE", 96, 72, (60.0, 48.0, 36.0, 0.02)),
    Lens("RADIAL_FISHEYE", 96, 72, (60.0, 48.0, 36.0, 0.02, -0.01)),
    Lens("SIMPLE_FISHEYE", 96, 72, (60.0, 48.0, 36.0)),
    Lens("FISHEYE", 96, 72, FISHEYE),
    Lens("THIN_PRISM_FISHEYE", 96, 72, (*FISHEYE, 0.02, -0.01, 0.001, 0.001, 0.0, 0.0, 0.001, 0.001)),
    Lens("RAD_TAN_THIN_PRISM_FISHEYE", 96, 72, (*FISHEYE, 0.02, -0.01, *[0.0] * 4, 0.001, 0.001, *[0.0] * 4)),
    Lens("SIMPLE_DIVISION", 96, 72, (80.0, 48.0, 36.0, -0.1)),
    Lens("DIVISION", 96, 72, (80.0, 82.0, 47.0, 37.0, -0.1)),
    Lens("EUCM", 96, 72, (80.0, 82.0, 47.0, 37.0, 0.5, 1.1)),
    Lens("PINHOLE", 96, 72, (80.0, 82.0, 47.0, 37.0)),
    Lens("SIMPLE_PINHOLE", 96, 72, (80.0, 48.0, 36.0)),
]


def pinhole_rays(lens):
    """Slopes x / z, y / z of the pixels of the lens's pinhole camera [H, W, 2]."""
    pinhole = lens.pinhole()
    x, y = np.meshgrid(np.arange(pinhole.width) + 0.5, np.arange(pinhole.height) + 0.5)
    return np.stack([(x - pinhole.cx) / pinhole.fx, (y - pinhole.cy) / pinhole.fy], axis=-1)


def test_every_model_of_colmap_is_tried():
    tried = {lens.model for lens in LENSES} | {"EQUIRECTANGULAR", "INVALID"}
    assert tried == set(pycolmap.CameraModelId.__members__)


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.model)
def test_undistorted_photograph_is_what_a_pinhole_camera_sees(lens):
    picture, expected = lens.undistort(photograph(lens)), colours(pinhole_rays(lens))
    assert picture.shape == expected.shape
    error = np.abs(picture - expected)
    assert error[1:-1, 1:-1].max() < 0.01  # bilinear sampling of a smooth function
    assert error.max() < 0.08  # the outermost half pixel is repeated


@pytest.mark.parametrize("long_side", [None, 1500, 400])
@pytest.mark.parametrize("lens", [None, Lens("OPENCV", 2000, 1500, (1600.0, 1600.0, 1000.0, 750.0, -0.05, 0.01, 0, 0))])
def test_a_photograph_takes_at_most_16_bytes_a_pixel(tmp_path, monkeypatch, long_side, lens):
    monkeypatch.setattr(lenses, "KEPT_MAP", 0)
    path = tmp_path / "photograph.jpg"
    cv2.imwrite(str(path), np.zeros((1500, 2000, 3), np.uint8))
    pinhole = (lens or Lens("PINHOLE", 2000, 1500, (1600.0, 1600.0, 1000.0, 750.0))).pinhole()
    camera = pinhole.camera(np.eye(4)).resized(*fitted_size(pinhole.width, pinhole.height, long_side))
    tracemalloc.start()
    rounded = View("photograph", camera, path, lens).rounded()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert rounded.shape == (camera.height, camera.width, 3)
    assert 2000 * 1500 * 6 < peak < pinhole.width * pinhole.height * 16


@pytest.mark.parametrize("long_side", [None, 45])
@pytest.mark.parametrize("kept", [0, 10**9])
@pytest.mark.parametrize("lens", [LENS, LENSES[5], LENSES[-2]], ids=lambda lens: lens.model)
def test_a_rounded_view_is_its_image_rounded(tmp_path, monkeypatch, lens, kept, long_side):
    monkeypatch.setattr(lenses, "KEPT_MAP", kept)
    path = tmp_path / "photograph.png"
    write_png(path, photograph(lens))
    camera = lens.pinhole().camera(np.eye(4))
    camera = camera.resized(*fitted_size(camera.width, camera.height, long_side))
    view = View("photograph", camera, path, None if lens.is_pinhole else lens)
    whole = resize_area(lens.undistort(read_image(path)), camera.width, camera.height)
    assert np.array_equal(view.image(), whole)
    assert np.array_equal(view.rounded(), to_uint8(whole))


def test_photograph_of_another_shape_is_refused(tmp_path):
    path = tmp_path / "tall.png"
    write_png(path, np.zeros((96, 72, 3), np.float32))
    with pytest.raises(InputError, match=r"tall\.png.*\n.*72x96 pixels\n.*96x72") as caught:
        View("tall", LENS.pinhole().camera(np.eye(4)), path, LENS).image()
    assert "what to do" in str(caught.value)
    with pytest.raises(ValueError, match="72x96"):
        LENS.undistort(np.zeros((96, 72, 3), np.float32))


@pytest.mark.parametrize(
    ("model", "params", "message"),
    [
        ("BROWN", (1.0,), "unknown camera model"),
        ("PINHOLE", (80.0, 82.0, 47.0), "found: 3 numbers"),
        ("PINHOLE", (80.0, float("nan"), 47.0, 37.0), "bad parameters"),
    ],
)
def test_bad_lenses_are_refused(model, params, message):
    with pytest.raises(InputError, match=message):
        Lens(model, 96, 72, params)


FOV = Lens("FOV", 256, 205, (89.4, 89.4, 128.0, 102.5, 0.933271))  # of TUM's monocular data set, scaled


def test_a_corner_without_a_direction_does_not_shrink_the_picture():
    """COLMAP would leave 51x41 pixels, 4 % of the photograph."""
    assert kept_share(FOV) > 0.6
    assert FOV.pinhole().width > 256
    rays = pinhole_rays(FOV)
    pixels = FOV.colmap().img_from_cam(np.dstack([rays, np.ones(rays.shape[:2])]).reshape(-1, 3))
    assert ((pixels >= 0) & (pixels <= (256, 205))).all()
    assert np.abs(FOV.undistort(photograph(FOV)) - colours(rays))[2:-2, 2:-2].mean() < 0.02


WIDE = Lens("OPENCV_FISHEYE", 2048, 2048, (400.0, 400.0, 1024.0, 1024.0, 0, 0, 0, 0))


@pytest.mark.parametrize(("lens", "share"), [(LENSES[-1], 1.0), (WIDE, 0.18)], ids=["pinhole", "fisheye"])
def test_the_share_that_is_left_is_known(lens, share):
    """Less than 2 x 68.7 degrees across and down is left of the fisheye."""
    assert kept_share(lens) == pytest.approx(share, abs=0.01)


def test_little_that_is_left_is_told(tmp_path):
    def said(lens):
        views = [View(f"{i}", lens.pinhole().camera(np.eye(4)), tmp_path / f"{i}.png", lens) for i in range(3)]
        return left_after_undistortion(make_scene("walk", views, no_points()))

    assert said(FOV) == said(LENS) == []
    (told,) = said(WIDE)
    assert "% of the photograph is left after undistortion" in told


def test_panoramas_are_refused():
    names = pycolmap.Camera.create_from_model_name(1, "EQUIRECTANGULAR", 1.0, 96, 48).params
    with pytest.raises(InputError, match="no pinhole camera"):
        Lens("EQUIRECTANGULAR", 96, 48, tuple(names)).pinhole()


def test_depth_maps_of_distorted_photographs_are_left_out_with_a_note(tmp_path):
    capture = colmap_capture(tmp_path / "yard")
    for path in (capture / "images").iterdir():
        write_depth(capture / "depth" / f"{path.stem}.exr", np.ones((LENS.height, LENS.width)))
    folder = build(read_scene(capture), tmp_path / "data", patterns=[])
    assert not (folder / "depth").exists()
    assert "9 depth maps left out" in (folder / "README.md").read_text()
