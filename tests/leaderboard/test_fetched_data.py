"""A packed variant that came from a server trains to the same record as the one that was built."""

from dataclasses import asdict

from servers import serving
from shared import built_in

from hydroviews.dataset.manifest import data_hash
from hydroviews.dataset.sharing.fetch import fetch
from hydroviews.dataset.sharing.pack import pack
from leaderboard.predict import train_and_render
from leaderboard.records import NOTED
from leaderboard.runs import Run, claim_folder
from leaderboard.score import score


def trained_record(data, results):
    run = Run("short_splatting:ShortSplatting", "demo", 0, data, "yard", "streak-1", results)
    claim_folder(run, overwrite=False)
    train_and_render(run)
    return {name: value for name, value in asdict(score(run)).items() if name not in NOTED}


def test_a_fetched_variant_trains_to_the_same_record(tmp_path, monkeypatch):
    for name in ("http_proxy", "HTTP_PROXY"):
        monkeypatch.delenv(name, raising=False)
    built = built_in(tmp_path)
    [(path, digest)] = pack(built, tmp_path / "out", patterns=["streak-1"])
    with serving({"/a.zip": path.read_bytes()}) as server:
        fetch(f"{server.address}/a.zip#sha256={digest}", tmp_path / "fetched")
    ours, theirs = (trained_record(data, tmp_path / data.name / "r") for data in (built.parent, tmp_path / "fetched"))
    assert ours == theirs
    assert ours["status"] == "done"
    assert ours["scores"]["psnr"] > 5
    assert ours["data_sha256"] == data_hash(built.parent, "yard", "streak-1")
