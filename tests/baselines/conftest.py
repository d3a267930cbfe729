"""What tests of methods share: kernels, and scenes and trainings that are made once."""

import sys
from pathlib import Path

import balls
import pytest
from disturbed import fitted, in_casts
from kernel_fixtures import compiled_kernels, one_thread, one_thread_for_what_is_shared  # noqa: F401
from looks import cast, occlude
from pretended_gpu import cuda_backend, pretended_gpu  # noqa: F401
from splats import photographed

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture(scope="session")
def ball(tmp_path_factory):
    """A striped ball before a patterned sky."""
    return balls.photographed(tmp_path_factory.mktemp("ball"))


@pytest.fixture(scope="session")
def ball_in_casts(ball, tmp_path_factory):
    """The ball, each training view with a colour cast of its own."""
    return in_casts(ball, tmp_path_factory.mktemp("casts"))


@pytest.fixture(scope="session")
def things(tmp_path_factory):
    """Small soft things, as they are."""
    return photographed(tmp_path_factory.mktemp("things"))


@pytest.fixture(scope="session")
def things_in_casts(tmp_path_factory):
    """The same, each training view with a colour cast of its own."""
    scene = photographed(tmp_path_factory.mktemp("casts"))
    cast(scene)
    return scene


@pytest.fixture(scope="session")
def things_occluded(tmp_path_factory):
    """The same behind a bright block in every third training view."""
    scene = photographed(tmp_path_factory.mktemp("occluded"))
    occlude(scene)
    return scene


@pytest.fixture(scope="session")
def plain(tmp_path_factory):
    """Trains what a method is compared with, once for all methods: `plain(kind, settings, one of the scenes above)`."""
    trained = {}

    def train(kind, settings, scene):
        key = kind, settings, scene.views[0].path
        if key not in trained:
            trained[key] = fitted(kind, settings, scene, tmp_path_factory.mktemp("plain"))
        return trained[key]

    return train
