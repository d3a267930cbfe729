import numba
import numpy as np
import torch
from scipy.spatial.transform import Rotation

from baselines.splatting.backends.torch_rasterizer import rotations
from baselines.splatting.kernels.splats.geometry import rotation, unit_quaternion
from hydroviews.scene.quaternions import rotation_entries, rotation_matrices

QUATERNIONS = np.random.default_rng(0).normal(size=(50, 4))


def test_matrices_are_those_of_scipy():
    expected = Rotation.from_quat(np.roll(QUATERNIONS, -1, axis=1)).as_matrix()
    assert np.allclose(rotation_matrices(QUATERNIONS), expected, atol=1e-14)
    assert np.allclose(rotation_matrices(3 * QUATERNIONS), expected, atol=1e-14)
    unit = QUATERNIONS[0] / np.linalg.norm(QUATERNIONS[0])
    assert np.allclose(np.reshape(rotation_entries(*unit), (3, 3)), expected[0], atol=1e-14)


def test_torch_and_the_kernels_have_the_same():
    expected = rotation_matrices(QUATERNIONS)
    assert np.allclose(rotations(torch.from_numpy(QUATERNIONS)).numpy(), expected, atol=1e-14)

    @numba.njit
    def compiled(quaternion):
        w, x, y, z, norm = unit_quaternion(quaternion[0], quaternion[1], quaternion[2], quaternion[3])
        return rotation(w, x, y, z), norm

    for quaternion, matrix in zip(QUATERNIONS, expected, strict=True):
        entries, norm = compiled(quaternion)
        assert np.allclose(np.reshape(entries, (3, 3)), matrix, atol=1e-14)
        assert np.isclose(norm, np.linalg.norm(quaternion))


def test_no_length_is_no_rotation():
    assert np.array_equal(rotation_matrices(np.zeros((1, 4))), [np.eye(3)])
