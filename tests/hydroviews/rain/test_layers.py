import numpy as np
import pytest

from hydroviews.errors import InputError
from hydroviews.rain.layers import read_layers, write_layers


def test_planes_come_back_as_half_floats(tmp_path):
    planes = {"M": np.random.default_rng(0).random((7, 5), np.float32), "R": np.full((7, 5), 3.25, np.float32)}
    write_layers(tmp_path / "a.exr", planes)
    read = read_layers(tmp_path / "a.exr")
    assert set(read) == {"M", "R"}
    for name, plane in planes.items():
        assert np.array_equal(read[name], plane.astype(np.float16).astype(np.float32))


@pytest.mark.parametrize("kept", [0, 10, 0.5, 0.99])
def test_truncated_file_is_refused(tmp_path, kept):
    path = tmp_path / "a.exr"
    write_layers(path, {"S": np.random.default_rng(0).random((64, 64))})
    content = path.read_bytes()
    path.write_bytes(content[: int(kept * len(content)) if isinstance(kept, float) else kept])
    with pytest.raises(InputError, match=r"a\.exr: not a readable EXR layer"):
        read_layers(path)
