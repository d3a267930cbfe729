"""Panoramas of 360 cameras are recognised and cut into perspective photographs, exact against the room."""

import numpy as np
import PIL.Image
import pytest
from painted_room import hits, paint, picture
from scipy.spatial.transform import Rotation

from hydroviews.__main__ import poses_command
from hydroviews.captures.panoramas import is_panorama, perspective
from hydroviews.captures.sfm.poses import estimate_poses
from hydroviews.errors import InputError
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import to_uint8

XMP = (
    b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    b'<rdf:Description xmlns:GPano="http://ns.google.com/photos/1.0/panorama/" '
    b'GPano:ProjectionType="equirectangular"/></rdf:RDF></x:xmpmeta>'
)
CENTRE = np.array([0.3, -0.2, 1.0])


def panorama(height=256, centre=CENTRE):
    """Exact, looking along z in its middle."""
    y, x = np.mgrid[:height, : 2 * height] + 0.5
    longitude, latitude = (x / height - 1) * np.pi, (0.5 - y / height) * np.pi
    level = np.cos(latitude)
    rays = np.stack([level * np.sin(longitude), -np.sin(latitude), level * np.cos(longitude)], axis=-1)
    return paint(centre + rays * hits(centre, rays)[..., None]).astype(np.float32)


@pytest.mark.parametrize("angle", [0, 60, 180, 300])
def test_what_is_cut_is_what_a_perspective_camera_would_see(angle):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("y", -angle, degrees=True).as_matrix()
    pose[:3, 3] = -pose[:3, :3] @ CENTRE
    found = perspective(panorama(), angle)
    exact = picture(Camera(128, 128, 64, 64, 64, 64, pose))
    assert found.shape == exact.shape
    assert -10 * np.log10(((found - exact) ** 2).mean()) > 38


def save(path, image, **options):
    PIL.Image.fromarray(to_uint8(image)).save(path, quality=95, **options)
    return path


def test_panoramas_are_recognised(tmp_path):
    exact = panorama()
    assert is_panorama(save(tmp_path / "said.jpg", exact, xmp=XMP))
    assert is_panorama(save(tmp_path / "by_its_seam.jpg", exact))
    assert not is_panorama(save(tmp_path / "cropped.jpg", exact[64:192, 100:356]))
    assert not is_panorama(save(tmp_path / "photograph.jpg", exact[:, :384]))
    with pytest.raises(InputError, match=r"part\.jpg: a part of a panorama\n.*512x128"):
        is_panorama(save(tmp_path / "part.jpg", exact[64:192], xmp=XMP))


def test_cameras_are_estimated_for_what_is_cut_and_refused_where_that_is_asked_for(tmp_path, monkeypatch):
    (tmp_path / "walk").mkdir()
    for i, name in enumerate(("R0.jpg", "R1.JPG", "R2.JPG")):
        save(tmp_path / "walk" / name, panorama(64, CENTRE + np.array([0.2 * i, 0, 0])), xmp=XMP)
    refused = r"panoramas, which no perspective camera takes[\s\S]*R0\.jpg, R1\.JPG, R2\.JPG"
    with pytest.raises(InputError, match=refused):
        poses_command(tmp_path / "walk", tmp_path / "refused", panoramas="refuse")

    def stop(database, pictures, names, *_, **__):
        assert names == [f"R{i}_{angle:03d}.jpg" for i in range(3) for angle in range(0, 360, 60)]
        assert {PIL.Image.open(pictures / name).size for name in names} == {(32, 32)}
        raise KeyboardInterrupt

    monkeypatch.setattr("hydroviews.captures.sfm.matching.register", stop)
    with pytest.raises(KeyboardInterrupt):
        estimate_poses(tmp_path / "walk", tmp_path / "out")
