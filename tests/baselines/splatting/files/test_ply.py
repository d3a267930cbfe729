"""Splat files: exact there and back, and what other programs' files must have."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.lib.recfunctions import repack_fields
from plyfile import PlyData, PlyElement
from splats import cloud

from baselines.splatting.files.checkpoints import read_model, write_model
from baselines.splatting.files.ply import read_ply, write_ply
from baselines.splatting.gaussians import FIELDS
from baselines.training.checkpoints import write_arrays
from hydroviews.errors import InputError

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
