"""Cameras that another seed does not find again are doubted."""

import numpy as np
import pycolmap
import pytest

from hydroviews.captures.sfm.mapping import map_photographs, rainy_options, warn_of_chance
from hydroviews.captures.sfm.room import DATABASE
from hydroviews.scene.images import write_png

VIEWS = 8


@pytest.fixture
def mapped(tmp_path):
    """A folder with cameras that were found for views around a sphere."""
    pycolmap.set_random_seed(0)
    size = {"num_rigs": 1, "num_cameras_per_rig": 1, "num_frames_per_rig": VIEWS, "num_points3D": 200}
    with pycolmap.Database.open(tmp_path / DATABASE) as opened:
        model = pycolmap.synthesize_dataset(pycolmap.SyntheticDatasetOptions(**size), opened)
    camera = next(iter(model.cameras.values()))
    for image in model.images.values():
        write_png(tmp_path / "images" / image.name, np.zeros((camera.height, camera.width, 3), np.uint8))
    map_photographs(tmp_path, VIEWS, rainy_options(0, 2.0), "add photographs")
    return tmp_path


def test_cameras_that_another_seed_places_elsewhere_are_doubted(mapped, caplog):
    warn_of_chance(mapped, VIEWS, rainy_options(1, 2.0))
    assert caplog.text == ""
    model = pycolmap.Reconstruction(mapped / "sparse" / "0")
    frames = [model.frames[frame] for frame in sorted(model.frames)]
    poses = [frame.rig_from_world for frame in frames]
    for frame, pose in zip(frames, poses[3:] + poses[:3], strict=True):
        frame.rig_from_world = pose
    model.write_binary(mapped / "sparse" / "0")
    warn_of_chance(mapped, VIEWS, rainy_options(1, 2.0))
    assert "the cameras may be wrong" in caplog.text
    assert str(mapped) in caplog.text
