"""The scene that most trainings of Gaussians learn."""

import pytest


@pytest.fixture(scope="session")
def scene(things):
    """Small soft things; not to be changed."""
    return things
