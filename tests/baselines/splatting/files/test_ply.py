"""Splat files: exact there and back, what others' must have; smaller and unfiltered ones show the same."""

import sys
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from compressed_ply import RUN, read_compressed_ply
from disturbed import fitted
from numpy.lib.recfunctions import repack_fields
from plyfile import PlyData, PlyElement
from splats import BACKGROUND, camera, cloud, photographed, with_values

from baselines.gaussian_splatting import GaussianSplattingClean
from baselines.splatting.files.checkpoints import read_model, write_model
from baselines.splatting.files.compact import cut_to_degree, neighbouring_order, without_unseen, write_compressed_ply
from baselines.splatting.files.ply import SPLATS, origin_comment, read_ply, write_ply
from baselines.splatting.files.unfiltered import without_filter
from baselines.splatting.gaussians import FIELDS, Gaussians
from baselines.splatting.kernels.constants import MIN_ALPHA
from baselines.splatting.rasterizer import render
from baselines.splatting.state import opacities
from baselines.splatting_profiles import PROFILES
from baselines.training.checkpoints import write_arrays
from hydroviews.errors import InputError
from hydroviews.metrics import psnr

FAR = replace(cloud(5, 1), origin=np.array([1e6 / 3, -2e6, 0.1]))


@pytest.mark.parametrize(
    "gaussians",
    [*(cloud(20, degree) for degree in range(4)), cloud(0, 2), FAR],
    ids=["degree 0", "degree 1", "degree 2", "degree 3", "none", "far away"],
)
def test_round_trip_is_exact(tmp_path, gaussians):
    write_ply(tmp_path / "splats.ply", gaussians)
    again = read_ply(tmp_path / "splats.ply")
    assert len(again) == len(gaussians)
    for name in (*FIELDS, "origin"):
        assert np.array_equal(getattr(gaussians, name), getattr(again, name)), name


def test_header_and_order_are_what_viewers_expect(tmp_path):
    gaussians = cloud(3, 3)
    write_ply(tmp_path / "splats.ply", gaussians)
    header = (tmp_path / "splats.ply").read_bytes().split(b"end_header")[0].decode().splitlines()
    assert header[:2] == ["ply", "format binary_little_endian 1.0"]
    rest = " ".join(f"f_rest_{i}" for i in range(45))
    expected = f"x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 {rest} opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3"
    assert [line.split()[-1] for line in header if line.startswith("property float")] == expected.split()
    vertex = PlyData.read(str(tmp_path / "splats.ply"))["vertex"]
    assert np.array_equal(vertex["f_rest_1"], gaussians.sh[:, 2, 0])  # red first ...
    assert np.array_equal(vertex["f_rest_15"], gaussians.sh[:, 1, 1])  # ... then green


def test_files_that_are_not_splats_are_refused(tmp_path):
    path = tmp_path / "splats.ply"

    def assert_refused(message):
        with pytest.raises(InputError, match=message):
            read_ply(path)

    assert_refused("no such file")
    path.write_bytes(b"not a ply at all")
    assert_refused("not a readable")
    write_ply(path, cloud(10, 3))
    path.write_bytes(path.read_bytes()[:-100])
    assert_refused("not a readable")
    points = np.zeros(2, [("x", "f4"), ("y", "f4"), ("z", "f4"), ("red", "u1")])
    PlyData([PlyElement.describe(points, "vertex")]).write(str(path))
    assert_refused("f_dc_0")
    write_ply(path, cloud(2, 1))
    vertex = PlyData.read(str(path))["vertex"].data
    kept = repack_fields(vertex[[name for name in vertex.dtype.names if name != "f_rest_8"]])
    PlyData([PlyElement.describe(kept, "vertex")]).write(str(path))
    assert_refused("8 f_rest")


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize(("write", "read"), [(write_ply, read_ply), (partial(write_model, about={}), read_model)])
def test_gaussians_that_are_not_finite_are_refused(tmp_path, write, read, value):
    gaussians = cloud(20, 1)
    gaussians.opacity_logits[3:5] = value
    write(tmp_path / "splats.ply", gaussians)
    with pytest.raises(InputError, match=r"not finite[\s\S]*in 2 of 20"):
        read(tmp_path / "splats.ply")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"log_scales": np.zeros((5, 3), np.float32)}, r"log_scales: float32 of shape \(5, 3\)"),
        ({"sh": np.zeros((20, 5, 3), np.float32)}, "not a model"),
        ({"means": np.zeros((20, 3))}, "means: float64"),
        ({"hack": np.zeros(3)}, "hack"),
    ],
)
def test_a_model_with_other_arrays_is_refused(tmp_path, changes, message):
    gaussians = cloud(20, 1)
    write_arrays(tmp_path / "model", {**gaussians.state_dict(), "origin": gaussians.origin, **changes}, {})
    with pytest.raises(InputError, match=message):
        read_model(tmp_path / "model")


SMALL = 0.06  # a packed position is off by a few thousandths of its run's bounds: Gaussians must not be smaller


def shown(gaussians: Gaussians) -> np.ndarray:
    return np.clip(render(gaussians, camera(160, 120))[0], 0, 1)


def test_gaussians_that_cannot_show_are_left_out_and_no_pixel_changes():
    least = np.log(MIN_ALPHA / (1 - MIN_ALPHA))
    gaussians = with_values(cloud(200, 1), "opacity_logits", slice(0, 50), least - 0.01)
    gaussians = with_values(gaussians, "opacity_logits", slice(50, 60), least + 0.01)
    smaller = without_unseen(gaussians)
    assert len(smaller) == np.count_nonzero(gaussians.opacity_logits >= least) < 200
    assert np.array_equal(shown(smaller), shown(gaussians))


def test_spherical_harmonics_are_cut_to_a_degree():
    gaussians = cloud(20, 3)
    cut = cut_to_degree(gaussians, 1)
    assert cut.sh_degree == 1
    assert np.array_equal(cut.sh, gaussians.sh[:, :4])
    with pytest.raises(InputError, match="--sh-degree 3"):
        cut_to_degree(cut, 3)


def packed(folder, gaussians):
    """Gaussians as a compressed file gives them back."""
    write_compressed_ply(folder / "small.ply", gaussians)
    return read_compressed_ply(folder / "small.ply")


@pytest.fixture
def library():
    pytest.importorskip("gsply", reason="needs the extra compression")


@pytest.mark.usefixtures("library")
class TestCompressed:
    @pytest.mark.parametrize("degree", [0, 1, 2, 3])
    def test_it_shows_nearly_the_same(self, tmp_path, degree):
        gaussians = cloud(2000, degree, size=SMALL)
        again = packed(tmp_path, gaussians)
        assert (len(again), again.sh_degree) == (2000, degree)
        assert psnr(shown(again), shown(gaussians)) > 35

    def test_every_value_comes_back_within_its_bits(self, tmp_path):
        gaussians = cloud(1000, 3)
        again, ours = packed(tmp_path, gaussians), gaussians.select(neighbouring_order(gaussians.means))
        for start in range(0, 1000, RUN):
            run = slice(start, start + RUN)
            for name in ("means", "log_scales"):
                step = np.ptp(getattr(ours, name)[run], axis=0) / (2 ** np.array([11, 10, 11]) - 1)
                error = np.abs(getattr(again, name)[run] - getattr(ours, name)[run])
                assert (error <= 0.51 * step + 1e-6).all()
        turned = np.abs((again.quaternions * ours.quaternions).sum(axis=1)) / np.linalg.norm(ours.quaternions, axis=1)
        assert turned.min() > 0.99999
        assert np.abs(again.sh[:, 1:] - ours.sh[:, 1:]).max() <= 1 / 64 + 1e-6
        assert np.abs(opacities(again) - opacities(ours)).max() <= 0.51 / 255

    @pytest.mark.parametrize("n", [1, RUN + 1])
    def test_a_run_of_one_or_of_equals_has_no_width(self, tmp_path, n):
        gaussians = with_values(cloud(n, 0), "log_scales", slice(None), -2.0)
        again = packed(tmp_path, gaussians)
        assert np.allclose(again.log_scales, -2)
        assert np.allclose(again.means, gaussians.means[neighbouring_order(gaussians.means)], atol=2e-3)

    def test_a_far_origin_stays_in_the_header(self, tmp_path):
        gaussians = replace(cloud(300, 1), origin=np.array([4e6, -1.0, 0.1]))
        assert np.abs(packed(tmp_path, gaussians).means).max() < 1.01
        assert PlyData.read(str(tmp_path / "small.ply")).comments == origin_comment(gaussians)

    @pytest.mark.parametrize("gaussians", [cloud(0, 1), with_values(cloud(5, 1), "means", 2, np.nan)])
    def test_what_cannot_be_written_is_refused(self, tmp_path, gaussians):
        with pytest.raises(InputError):
            write_compressed_ply(tmp_path / "small.ply", gaussians)
        assert not list(tmp_path.iterdir())


def test_without_the_library_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "gsply", None)
    with pytest.raises(InputError, match=r"\.\[compression\]"):
        write_compressed_ply(tmp_path / "small.ply", cloud(5, 0))


@pytest.mark.parametrize("origin", [(0, 0, 0), (5e5, -3e4, 100)])
def test_seen_from_one_camera_it_is_the_same_picture(origin):
    small = replace(cloud(300, size=0.01), origin=np.array(origin, float))
    small = with_values(small, "opacity_logits", slice(0, 20), 60.0)
    one, near = camera(64, 48, origin=origin), 0.1

    def pictured(gaussians, antialiased=False):
        return np.clip(render(gaussians, one, BACKGROUND, near=near, antialiased=antialiased)[0], 0, 1)

    assert np.abs(pictured(small) - pictured(small, antialiased=True)).max() > 0.3
    found = without_filter(small, [one], near)
    assert np.isfinite(found.opacity_logits).all()
    # A splat whose middle lies outside of the picture is as it was: it is left out of the comparison.
    pixels, _ = one.project(small.means + small.origin)
    inside = ((pixels >= 0) & (pixels <= (64, 48))).all(axis=1)
    expected = pictured(small.select(inside), antialiased=True)
    np.testing.assert_allclose(pictured(found.select(inside)), expected, atol=2e-5)


def test_what_a_training_leaves_for_viewers_is_what_it_renders(tmp_path):
    scene = photographed(tmp_path, n_views=6)
    growth = replace(PROFILES["demo"].strategy, start=20, stop=50)
    config = replace(PROFILES["demo"], iterations=60, antialiased=True, strategy=growth)
    method = fitted(GaussianSplattingClean, config, scene, tmp_path)
    method.save(tmp_path)
    for_viewers, exact = read_ply(tmp_path / SPLATS), method.export_gaussians()
    for view in scene.test_views:
        rendered, black = method.render(view.camera), np.zeros(3, np.float32)
        folded, bare = (np.clip(render(g, view.camera, black)[0], 0, 1) for g in (for_viewers, exact))
        assert psnr(folded, rendered) > psnr(bare, rendered) + 6
    (tmp_path / "again").mkdir()
    GaussianSplattingClean.load(config, 0, tmp_path).save(tmp_path / "again")
    assert (tmp_path / "again" / SPLATS).read_bytes() == (tmp_path / SPLATS).read_bytes()
