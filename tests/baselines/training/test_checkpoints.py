"""Trees of states on disk."""

import numpy as np
import pytest

from baselines.training.checkpoints import load_checkpoint, save_checkpoint, write_arrays
from hydroviews.errors import InputError

TREE = {
    "iteration": 7,
    "seconds": 0.1 + 0.2,
    "curve": [{"step": 1, "loss": 1 / 3}],
    "nothing": {},
    "network": {"first.weight": np.arange(6, dtype=np.float32).reshape(2, 3), "step": np.array([3.0])},
    "objective": {"rain": {"total.0": np.array([], np.int64)}, "name": "Objective", "last": None},
}


def same(one, other):
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[name], other[name]) for name in one)
    return one == other


def test_a_tree_comes_back(tmp_path):
    save_checkpoint(tmp_path / "a", TREE, {"seed": 0})
    assert same(TREE, load_checkpoint(tmp_path / "a", {"seed": 0}))


@pytest.mark.parametrize("name", ["a/b", "", 3])
def test_names_that_could_not_be_found_again_are_refused(tmp_path, name):
    with pytest.raises(ValueError, match="expected a name without /"):
        save_checkpoint(tmp_path / "a", {"part": {name: 1}}, {})
    assert not list(tmp_path.iterdir())


def test_what_is_neither_array_nor_json_is_refused(tmp_path):
    with pytest.raises(TypeError):
        save_checkpoint(tmp_path / "a", {"part": object()}, {})
    assert not list(tmp_path.iterdir())


def test_another_seed_is_another_run(tmp_path):
    save_checkpoint(tmp_path / "a", TREE, {"seed": 0, "configuration": {"rate": 1, "steps": 2}})
    with pytest.raises(InputError, match="another run, with a different configuration, seed") as error:
        load_checkpoint(tmp_path / "a", {"seed": 1, "configuration": {"rate": 3, "steps": 2}})
    assert "{'rate': 1}" in str(error.value)
    assert "steps" not in str(error.value)


def test_files_that_are_no_checkpoints_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_checkpoint(tmp_path / "a", {})
    write_arrays(tmp_path / "a", {"weight": np.zeros(3)}, {"fingerprint": {"seed": 0}, "iteration": 3})
    with pytest.raises(InputError, match="of another version"):
        load_checkpoint(tmp_path / "a", {"seed": 0})
