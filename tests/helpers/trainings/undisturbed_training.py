"""A network's training that nothing disturbed, made once for the tests of a module that has `learn(folder)`."""

import shutil
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def undisturbed(request, tmp_path_factory):
    """The folder of a training, and the training."""
    folder = tmp_path_factory.mktemp("undisturbed")
    return folder, request.module.learn(folder)


@pytest.fixture
def finished(undisturbed, tmp_path):
    """Its folder again, for the test to change."""
    return Path(shutil.copytree(undisturbed[0], tmp_path / "finished"))
