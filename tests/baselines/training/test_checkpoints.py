"""Trees of states on disk."""

from dataclasses import replace

import numpy as np
import pytest
from splats import photographed
from trainings import CONFIG

from baselines.training.checkpoints import fingerprint_of, load_checkpoint, save_checkpoint, settings_of, write_arrays
from baselines.training.images import TrainingImages
from hydroviews.errors import InputError, MachineError
from hydroviews.scene.scenes import Points

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


def test_a_tree_comes_back_to_the_same_run_alone(tmp_path):
    run = {"seed": 0, "configuration": {"rate": 1, "steps": 2}}
    save_checkpoint(tmp_path / "a", TREE, run)
    assert same(TREE, load_checkpoint(tmp_path / "a", run))
    with pytest.raises(InputError, match="another run, with a different configuration, seed") as error:
        load_checkpoint(tmp_path / "a", {"seed": 1, "configuration": {"rate": 3, "steps": 2}})
    assert "{'rate': 1}" in str(error.value)
    assert "steps" not in str(error.value)


@pytest.mark.parametrize(
    ("part", "error"), [({"a/b": 1}, ValueError), ({"": 1}, ValueError), ({3: 1}, ValueError), (object(), TypeError)]
)
def test_what_could_not_be_read_again_is_refused(tmp_path, part, error):
    with pytest.raises(error):
        save_checkpoint(tmp_path / "a", {"part": part}, {})
    assert not list(tmp_path.iterdir())


def test_a_fingerprint_tells_whatever_leads_to_another_result(tmp_path):
    scene = photographed(tmp_path, n_views=3)
    points, pictures = scene.points, [view.rounded() for view in scene.train_views]

    def of(config=CONFIG, seed=0, points=points, pictures=pictures, **camera):
        views = tuple(replace(view, camera=replace(view.camera, **camera)) for view in scene.views)
        changed = replace(scene, views=views, points=points)
        return fingerprint_of(settings_of(config), seed, changed, TrainingImages(pictures))

    fingerprints = [
        of(),
        of(replace(CONFIG, iterations=7)),
        of(seed=1),
        of(points=Points(points.positions + 1e-6, points.colours)),
        of(points=Points(points.positions, points.colours ^ 1)),
        of(pictures=[pictures[0] ^ 1, *pictures[1:]]),
        of(world_to_camera=np.eye(4)),
        *(of(**{name: 20.0}) for name in ("fx", "fy", "cx", "cy")),
    ]
    assert not [one for i, one in enumerate(fingerprints) if one in fingerprints[:i]]
    assert of() == of(replace(CONFIG, checkpoint_seconds=1.0, device="cuda"))


@pytest.mark.parametrize("kept", [0.0, 0.01, 0.5, 0.99])
def test_a_checkpoint_that_is_cut_is_the_machines_fault(tmp_path, kept):
    save_checkpoint(tmp_path / "a", {"weight": np.zeros(3000)}, {"seed": 0})
    content = (tmp_path / "a").read_bytes()
    (tmp_path / "a").write_bytes(content[: int(kept * len(content))])
    with pytest.raises(MachineError, match=r"a: damaged\n[\s\S]*remove the file and start again") as error:
        load_checkpoint(tmp_path / "a", {"seed": 0})
    assert error.value.__cause__ is None


def test_files_that_are_no_checkpoints_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_checkpoint(tmp_path / "a", {})
    write_arrays(tmp_path / "a", {"weight": np.zeros(3)}, {"fingerprint": {"seed": 0}, "iteration": 3})
    with pytest.raises(InputError, match="of another version"):
        load_checkpoint(tmp_path / "a", {"seed": 0})
