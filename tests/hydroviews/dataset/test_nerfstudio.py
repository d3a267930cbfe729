"""nerfstudio's own readers on a built variant, where it is installed."""

from pathlib import Path

import numpy as np
import pytest
from built_yard import built_yard

from hydroviews.dataset.variants import open_variant

READERS = {
    "Colmap": {"colmap_path": Path("sparse/0"), "assume_colmap_world_coordinate_convention": False},
    "Nerfstudio": {},
}
AS_IT_IS = {"orientation_method": "none", "center_method": "none", "auto_scale_poses": False, "downscale_factor": 1}
OPENGL = np.array([1, -1, -1])  # y up, looking along -z


@pytest.fixture(scope="module")
def yard(tmp_path_factory):
    return built_yard(tmp_path_factory.mktemp("yard"))


@pytest.fixture(params=READERS)
def reader(request, yard):
    name = f"nerfstudio.data.dataparsers.{request.param.lower()}_dataparser"
    module = pytest.importorskip(name, reason="nerfstudio is not installed")
    config = getattr(module, f"{request.param}DataParserConfig")
    return config(data=yard / "streak-0", **AS_IT_IS, **READERS[request.param]).setup()


def test_cameras_and_pictures_are_those_of_the_variant(reader, yard):
    views = {view.path.resolve(): view for view in open_variant(yard, "streak-0").views}
    found = [reader.get_dataparser_outputs(split) for split in ("train", "val")]
    assert sum(len(part.image_filenames) for part in found) == len(views)
    for part in found:
        for path, pose, *lens in zip(
            part.image_filenames,
            part.cameras.camera_to_worlds.double().numpy(),
            *(getattr(part.cameras, name)[:, 0].numpy() for name in ("fx", "fy", "cx", "cy", "width", "height")),
            strict=True,
        ):
            camera = views.pop(Path(path).resolve()).camera
            np.testing.assert_allclose(pose[:, :3] * OPENGL, camera.world_to_camera[:3, :3].T, atol=1e-6)
            np.testing.assert_allclose(pose[:, 3], np.linalg.inv(camera.world_to_camera)[:3, 3], atol=1e-5)
            ours = [camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height]
            np.testing.assert_allclose(lens, ours, rtol=1e-6)
    assert not views


@pytest.mark.parametrize("reader", ["Colmap"], indirect=True)
def test_colmap_projects_are_split_as_ours_and_have_all_points(reader, yard):
    scene = open_variant(yard, "streak-0")
    train, held_out = (reader.get_dataparser_outputs(split) for split in ("train", "val"))
    assert [Path(path).stem for path in held_out.image_filenames] == [view.name for view in scene.test_views]
    assert len(train.image_filenames) == len(scene.train_views)
    assert len(train.metadata["points3D_xyz"]) == len(scene.points)
