import pytest
from shared_data_set import built_in

from hydroviews.dataset.sharing.pack import pack


@pytest.fixture(scope="session")
def built(tmp_path_factory):
    """A built scene, not to be changed."""
    return built_in(tmp_path_factory.mktemp("shared"))


@pytest.fixture(scope="session")
def archives(built, tmp_path_factory):
    """Its archives by variant."""
    return {path.stem.removeprefix("yard-"): path for path, _ in pack(built, tmp_path_factory.mktemp("archives"))}


@pytest.fixture(scope="session")
def archive(archives):
    """That of its streaks."""
    return archives["streak-1"]
