"""Splat files: exact there and back, what others' must have; smaller and unfiltered ones show the same."""

import sys
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from compressed_ply import RUN, read_compressed_ply
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
    names = [line.split()[-1] for line in header if line.startswith("property float")]
    rest = [f"f_rest_{i}" for i in range(45)]
    scale, rotation = [f"scale_{i}" for i in range(3)], [f"rot_{i}" for i in range(4)]
    expected = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", *rest, "opacity", *scale, *rotation]
    assert names == expected
    vertex = PlyData.read(str(tmp_path / "splats.ply"))["vertex"]
    assert np.array_equal(vertex["f_rest_1"], gaussians.sh[:, 2, 0])  # red first ...
    assert np.array_equal(vertex["f_rest_15"], gaussians.sh[:, 1, 1])  # ... then green


def test_files_that_are_not_splats_are_refused(tmp_path):
    path = tmp_path / "splats.ply"
    with pytest.raises(InputError, match="no such file"):
        read_ply(path)
    path.write_bytes(b"not a ply at all")
    with pytest.raises(InputError, match="not a readable"):
        read_ply(path)
    write_ply(path, cloud(10, 3))
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match="not a readable"):
        read_ply(path)
    points = np.zeros(2, [("x", "f4"), ("y", "f4"), ("z", "f4"), ("red", "u1")])
    PlyData([PlyElement.describe(points, "vertex")]).write(str(path))
    with pytest.raises(InputError, match="f_dc_0"):
        read_ply(path)


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


def test_an_odd_number_of_coefficients_is_refused(tmp_path):
    write_ply(tmp_path / "splats.ply", cloud(2, 1))
    vertex = PlyData.read(str(tmp_path / "splats.ply"))["vertex"].data
    names = [name for name in vertex.dtype.names if name != "f_rest_8"]
    PlyData([PlyElement.describe(repack_fields(vertex[names]), "vertex")]).write(str(tmp_path / "odd.ply"))
    with pytest.raises(InputError, match="8 f_rest"):
        read_ply(tmp_path / "odd.ply")


SMALL = 0.06  # a packed position is off by a few thousandths of its run's bounds: Gaussians must not be smaller


def shown(gaussians: Gaussians) -> np.ndarray:
    return np.clip(render(gaussians, camera(160, 120))[0], 0, 1)


def test_gaussians_that_cannot_show_are_left_out_and_no_pixel_changes():
    gaussians = cloud(200, 1)
    least = np.log(MIN_ALPHA / (1 - MIN_ALPHA))
    gaussians = with_values(gaussians, "opacity_logits", slice(0, 50), least - 0.01)
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


class TestCompressed:
    @pytest.fixture(autouse=True)
    def library(self):
        pytest.importorskip("gsply", reason="needs the extra compression")

    @pytest.mark.parametrize("degree", [0, 1, 2, 3])
    def test_it_shows_nearly_the_same(self, tmp_path, degree):
        gaussians = cloud(2000, degree, size=SMALL)
        write_compressed_ply(tmp_path / "small.ply", gaussians)
        again = read_compressed_ply(tmp_path / "small.ply")
        assert len(again) == 2000
        assert again.sh_degree == degree
        assert psnr(shown(again), shown(gaussians)) > 35

    def test_every_value_comes_back_within_its_bits(self, tmp_path):
        gaussians = cloud(1000, 3)
        write_compressed_ply(tmp_path / "small.ply", gaussians)
        again, ours = read_compressed_ply(tmp_path / "small.ply"), gaussians.select(neighbouring_order(gaussians.means))
        for start in range(0, 1000, RUN):
            run = slice(start, start + RUN)
            for name in ("means", "log_scales"):
                step = np.ptp(getattr(ours, name)[run], axis=0) / (2 ** np.array([11, 10, 11]) - 1)
                error = np.abs(getattr(again, name)[run] - getattr(ours, name)[run])
                assert (error <= 0.51 * step + 1e-6).all()
        turned = np.abs((again.quaternions * ours.quaternions).sum(axis=1)) / np.linalg.norm(ours.quaternions, axis=1)
        assert turned.min() > 0.99999
        assert np.abs(again.sh[:, 1:] - ours.sh[:, 1:]).max() <= 1 / 64 + 1e-6
        opacities = [1 / (1 + np.exp(-g.opacity_logits)) for g in (again, ours)]
        assert np.abs(opacities[0] - opacities[1]).max() <= 0.51 / 255

    @pytest.mark.parametrize("n", [1, RUN + 1])
    def test_a_run_of_one_or_of_equals_has_no_width(self, tmp_path, n):
        gaussians = with_values(cloud(n, 0), "log_scales", slice(None), -2.0)
        write_compressed_ply(tmp_path / "small.ply", gaussians)
        again = read_compressed_ply(tmp_path / "small.ply")
        assert np.allclose(again.log_scales, -2)
        assert np.allclose(again.means, gaussians.means[neighbouring_order(gaussians.means)], atol=2e-3)

    def test_a_far_origin_stays_in_the_header(self, tmp_path):
        gaussians = replace(cloud(300, 1), origin=np.array([4e6, -1.0, 0.1]))
        write_compressed_ply(tmp_path / "small.ply", gaussians)
        assert PlyData.read(str(tmp_path / "small.ply")).comments == origin_comment(gaussians)
        assert np.abs(read_compressed_ply(tmp_path / "small.ply").means).max() < 1.01

    def test_what_cannot_be_written_is_refused(self, tmp_path):
        for gaussians in (cloud(0, 1), with_values(cloud(5, 1), "means", 2, np.nan)):
            with pytest.raises(InputError):
                write_compressed_ply(tmp_path / "small.ply", gaussians)
        assert not list(tmp_path.iterdir())


def test_without_the_library_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "gsply", None)
    with pytest.raises(InputError, match=r"\.\[compression\]"):
        write_compressed_ply(tmp_path / "small.ply", cloud(5, 0))


NEAR = 0.1


def pictured(gaussians, seen_from, **options):
    return np.clip(render(gaussians, seen_from, BACKGROUND, near=NEAR, **options)[0], 0, 1)


@pytest.mark.parametrize("origin", [(0, 0, 0), (5e5, -3e4, 100)])
def test_seen_from_one_camera_it_is_the_same_picture(origin):
    small = replace(cloud(300, size=0.01), origin=np.array(origin, float))
    small = with_values(small, "opacity_logits", slice(0, 20), 60.0)
    one = camera(64, 48, origin=origin)
    expected = pictured(small, one, antialiased=True)
    assert np.abs(pictured(small, one) - expected).max() > 0.3
    found = without_filter(small, [one], NEAR)
    # A splat whose middle lies outside of the picture is as it was: it is left out of the comparison.
    pixels, _ = one.project(small.means + small.origin)
    inside = ((pixels >= 0) & (pixels <= (64, 48))).all(axis=1)
    np.testing.assert_allclose(
        pictured(found.select(inside), one), pictured(small.select(inside), one, antialiased=True), atol=2e-5
    )
    assert np.isfinite(found.opacity_logits).all()


def test_what_a_training_leaves_for_viewers_is_what_it_renders(tmp_path):
    scene = photographed(tmp_path, n_views=6)
    demo = PROFILES["demo"]
    config = replace(demo, iterations=60, antialiased=True, strategy=replace(demo.strategy, start=20, stop=50))
    method = GaussianSplattingClean(config, 0)
    method.fit(scene, tmp_path)
    method.save(tmp_path)
    for_viewers, exact = read_ply(tmp_path / SPLATS), method.export_gaussians()
    for view in scene.test_views:
        background = np.zeros(3, np.float32)
        rendered = method.render(view.camera)
        folded, bare = (np.clip(render(g, view.camera, background)[0], 0, 1) for g in (for_viewers, exact))
        assert psnr(folded, rendered) > psnr(bare, rendered) + 6
    again = GaussianSplattingClean.load(config, 0, tmp_path)
    (tmp_path / "again").mkdir()
    again.save(tmp_path / "again")
    assert (tmp_path / "again" / SPLATS).read_bytes() == (tmp_path / SPLATS).read_bytes()
