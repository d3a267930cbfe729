"""Views that mapping put in a wrong place are found and put where they belong; right ones stay."""

import numpy as np
import pycolmap
import pytest

from hydroviews.captures.sfm.reregistration import misplaced, settled

VIEWS, ERROR = 8, 2.0


@pytest.fixture
def mapped(tmp_path):
    """A model of eight views of 200 points, and the database of their matches."""
    pycolmap.set_random_seed(0)
    options = pycolmap.SyntheticDatasetOptions(
        num_rigs=1, num_cameras_per_rig=1, num_frames_per_rig=VIEWS, num_points3D=200
    )
    database = tmp_path / "database.db"
    with pycolmap.Database.open(database) as opened:
        model = pycolmap.synthesize_dataset(options, opened)
    (tmp_path / "images").mkdir()
    return model, database


def centres(model):
    return np.array([model.images[image].projection_center() for image in sorted(model.reg_image_ids())])


def displaced(model, shift):
    """The model with its third view elsewhere, without any observation of this view."""
    wrong = pycolmap.Reconstruction(model)
    view = wrong.images[sorted(wrong.reg_image_ids())[2]]
    right = view.cam_from_world()
    view.frame.set_cam_from_world(
        view.camera_id, pycolmap.Rigid3d(right.rotation, right.translation + np.array([shift, 0, 0]))
    )
    for index, point in enumerate(view.points2D):
        if point.has_point3D():
            wrong.delete_observation(view.image_id, index)
    return wrong


def test_a_misplaced_view_is_put_where_the_others_see_it(mapped, tmp_path):
    model, database = mapped
    wrong = displaced(model, 3.0)
    assert set(misplaced(wrong, database, ERROR, seed=0)) == {sorted(model.reg_image_ids())[2]}
    before = centres(wrong)
    found = settled(wrong, database, tmp_path / "images", ERROR, seed=0)
    assert np.array_equal(centres(wrong), before)  # the given model stays
    apart = [np.linalg.norm(one[:, None] - one[None], axis=2) for one in (centres(found), centres(model))]
    scale = apart[1].sum() / apart[0].sum()  # adjusting leaves the scale open
    np.testing.assert_allclose(apart[0] * scale, apart[1], atol=0.02 * apart[1].max())
    assert found.num_reg_images() == VIEWS


def test_a_model_without_misplaced_views_stays(mapped, tmp_path):
    model, database = mapped
    assert misplaced(model, database, ERROR, seed=0) == {}
    found = settled(model, database, tmp_path / "images", ERROR, seed=0)
    np.testing.assert_allclose(centres(found), centres(model), atol=1e-3)


def test_a_view_that_shares_nothing_stays(mapped):
    model, database = mapped
    wrong = displaced(model, 3.0)
    with pycolmap.Database.open(database) as opened:
        lonely = sorted(model.reg_image_ids())[2]
        for image in model.reg_image_ids():
            if image != lonely and opened.exists_matches(lonely, image):
                opened.delete_matches(lonely, image)
    assert misplaced(wrong, database, ERROR, seed=0) == {}
