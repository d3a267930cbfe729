"""Results for nerfbaselines: read as it reads them, and by itself where it is installed."""

import base64
import json
import struct

import pandas as pd
import pytest

from hydroviews.errors import InputError
from hydroviews.files.atomic import write_json
from leaderboard.__main__ import export_command


@pytest.fixture
def run(evaluated, tmp_path):
    return tmp_path / "results/demo/toy_methods.MeanColour/yard/streak-0/seed-0"


def test_scores_of_every_view_come_back(run, tmp_path):
    export_command(run, tmp_path / "results.json", "nerfbaselines")
    written = json.loads((tmp_path / "results.json").read_text())
    views = pd.read_csv(run / "per_view.csv")
    for theirs, ours in {"psnr": "psnr", "ssim": "ssim", "lpips": "lpips_alex", "lpips_vgg": "lpips_vgg"}.items():
        raw = base64.b64decode(written["metrics_raw"][theirs])
        assert struct.unpack(f"<{len(views)}f", raw) == pytest.approx(views[ours], abs=1e-5)
        assert written["metrics"][theirs] == pytest.approx(views[ours].mean(), abs=1e-5)
    assert written["nb_info"]["method"] == "toy_methods:MeanColour"
    assert written["render_dataset_metadata"]["scene"] == "yard-streak-0"


def test_the_digest_of_scores_does_not_depend_on_the_order_of_views(run, tmp_path):
    """nerfbaselines sorts them before it compares it."""
    views, digests = pd.read_csv(run / "per_view.csv", dtype={"view": str}), set()
    for step in (1, -1):
        views[::step].to_csv(run / "per_view.csv", index=False)
        export_command(run, tmp_path / f"{step}.json", "nerfbaselines")
        digests.add(json.loads((tmp_path / f"{step}.json").read_text())["metrics_sha256"])
    assert len(digests) == 1


def test_its_own_reader_takes_them(run, tmp_path):
    results = pytest.importorskip("nerfbaselines.results", reason="nerfbaselines is not installed")
    hashing = pytest.importorskip("nerfbaselines.io")
    export_command(run, tmp_path / "out/results.json", "nerfbaselines")
    written = json.loads((tmp_path / "out/results.json").read_text())
    read = results.load_metrics_from_results(written)
    views = pd.read_csv(run / "per_view.csv")
    assert list(read["psnr"]) == pytest.approx(views.psnr, abs=1e-5)
    assert hashing.get_metrics_hash({name: read[name] for name in written["metrics_raw"]}) == written["metrics_sha256"]
    (found,) = results._list_dataset_results(tmp_path / "out", "hydroviews-demo")
    assert found[1]["nb_info"]["method"] == "toy_methods:MeanColour"
    assert all(value is not None for value in read.values())  # of which it takes means


def test_a_metric_that_could_not_be_had_is_left_out(run, tmp_path):
    record = json.loads((run / "record.json").read_text())
    write_json(run / "record.json", {**record, "lpips_vgg": None, "status": "partial"})
    pd.read_csv(run / "per_view.csv", dtype={"view": str}).assign(lpips_vgg=None).to_csv(run / "per_view.csv")
    export_command(run, tmp_path / "results.json", "nerfbaselines")
    written = json.loads((tmp_path / "results.json").read_text(), parse_constant=pytest.fail)  # NaN is not JSON
    assert list(written["metrics"]) == list(written["metrics_raw"]) == ["psnr", "ssim", "lpips"]


def test_what_cannot_be_written(run, tmp_path):
    with pytest.raises(InputError, match=r"\.json"):
        export_command(run, tmp_path / "results.ply", "nerfbaselines")
    with pytest.raises(InputError):
        export_command(tmp_path, tmp_path / "results.json", "nerfbaselines")
    with pytest.raises(InputError, match="no spherical harmonics"):
        export_command(run, tmp_path / "results.json", "nerfbaselines", 1)
