"""A packed variant that came from a server trains to the same record as the one that was built."""

import json
from dataclasses import asdict

import pytest
from shared_data_set import SHAREABLE, built_in
from synthetic import written_capture

from hydroviews.dataset.manifest import data_hash
from hydroviews.dataset.sharing.fetch import fetch
from hydroviews.dataset.sharing.pack import pack
from hydroviews.dataset.sources import build_source
from hydroviews.errors import InputError
from hydroviews.profiles import find_profile
from leaderboard.evaluate import evaluate
from leaderboard.records import NOTED


@pytest.mark.usefixtures("toys", "trained_here")
def test_an_evaluation_of_fetched_data_gives_the_records_of_the_original(tmp_path, request_of):
    def evaluated(scene, folder):
        """The fields of records on data and scores, without machine and time."""
        where = {"data": folder / "data", "results": folder / "results"}
        records = evaluate(request_of(scene=str(scene), patterns=("streak-1",), **where))
        return [{name: value for name, value in asdict(one).items() if name not in NOTED} for one in records]

    capture, ours, theirs = written_capture(tmp_path / "yard"), tmp_path / "ours", tmp_path / "theirs"
    (capture / "capture.json").write_text(json.dumps(SHAREABLE))
    original = evaluated(capture, ours)
    [(path, _)] = pack(ours / "data/demo/yard", tmp_path / "out", patterns=["streak-1"])
    fetch(str(path), theirs / "data/demo")
    assert evaluated("yard", theirs) == original
    assert [(one["status"], one["pattern"]) for one in original] == [("done", "clean"), ("done", "streak-1")]
    hashes = [data_hash(ours / "data/demo", "yard", name) for name in ("clean", "streak-1")]
    assert [one["data_sha256"] for one in original] == hashes
    assert original[0]["scores"]["psnr"] > original[1]["scores"]["psnr"] > 5


def test_an_evaluation_needs_no_capture_for_what_was_fetched(tmp_path):
    """It takes the scene as it is, by its name, and compares it with the manifest; what is missing has to be built."""
    built = built_in(tmp_path)
    for path, _ in pack(built, tmp_path / "out", patterns=["streak-1", "clean"]):
        fetch(str(path), tmp_path / "data/fetched")
    data, demo = tmp_path / "data/fetched", find_profile("demo")
    assert build_source("yard", data, demo, patterns=("streak-1",), captures=tmp_path / "none") == data / "yard"
    assert build_source("./yard", data, demo, captures=tmp_path / "none") == data / "yard"
    for settings in ({"patterns": ("storm-1",)}, {"all_patterns": True}, {"seed": 3}, {"long_side": 20}):
        with pytest.raises(InputError, match=r"capture is not here\n.*clean, streak-1, 320 pixels, seed 0"):
            build_source("yard", data, demo, captures=tmp_path / "none", **settings)
    again = build_source(str(tmp_path / "captures/yard"), data, demo, patterns=("storm-1",))
    assert data_hash(data, "yard", "storm-1") == data_hash(built.parent, "yard", "storm-1")
    (again / "clean/view-00.png").unlink()
    fetched = fetch(str(tmp_path / "out/yard-clean.zip"), tmp_path / "other")
    (fetched / "clean/view-00.png").unlink()
    (fetched / "clean/view-00.png").write_bytes(b"changed")
    with pytest.raises(InputError, match="not what the manifest says"):
        build_source("yard", tmp_path / "other", demo, captures=tmp_path / "none")
