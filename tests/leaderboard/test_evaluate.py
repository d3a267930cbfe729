import dataclasses
import json
import re
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import finished_runs
import numpy as np
import pandas as pd
import pytest
from processes import PATIENCE

import hydroviews
from hydroviews import metrics
from hydroviews.errors import InputError
from hydroviews.files.locks import BUSY, locked
from hydroviews.files.ownership import FILES
from hydroviews.scene.images import read_image
from leaderboard import evaluate as evaluate_module
from leaderboard.__main__ import score_command, table_command
from leaderboard.evaluate import EvaluateRequest, evaluate, outcome
from leaderboard.records import as_row, code_version, columns
from leaderboard.runs import train_and_render as predict_module
from leaderboard.runs.probe import probe
from leaderboard.runs.supervision import Limits
from leaderboard.scoring.score import score
from leaderboard.sweep import task

pytestmark = pytest.mark.usefixtures("toys", "trained_here")
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="a folder that takes no folders")


def leaderboard(tmp_path: Path) -> pd.DataFrame:
    return pd.read_csv(tmp_path / "results" / "leaderboard.csv")


def test_rows_renders_and_scores(run, evaluated, tmp_path):
    table = leaderboard(tmp_path)
    assert list(table.columns) == columns()
    rows = table[["method", "effect", "n_test"]].to_numpy().tolist()
    assert rows == [["toy_methods:MeanColourClean", "clean", 2], ["toy_methods:MeanColour", "streak", 2]]
    folder, clean = run.folder, tmp_path / "data/demo/yard/clean"
    scores = [metrics.psnr(read_image(p), read_image(clean / p.name)) for p in (folder / "renders").iterdir()]
    assert evaluated.scores["psnr"] == pytest.approx(np.mean(scores), abs=1e-4)
    assert (evaluated.train_s, evaluated.n_primitives) == (0.5, None)
    assert evaluated.peak_mem_mb > 10
    assert (folder / "preview.png").is_file()


def test_files_of_the_users_in_the_folders_of_runs_stay(request_of, run, evaluated, tmp_path):
    folder = run.folder
    config = json.loads((folder / "config.json").read_text())
    (folder / "config.json").write_text(json.dumps(config | {"config": {"shift": 0.5}}))
    mine = [folder / "notes.txt", folder / "figures/best.png", tmp_path / "results/tables.md"]
    for path in mine:
        path.parent.mkdir(exist_ok=True)
        path.write_text("mine")
    (tmp_path / "results" / FILES).unlink()
    evaluate(request_of("MeanColour", overwrite=True))
    assert json.loads((folder / "config.json").read_text()) == config
    assert [path.read_text() for path in (*mine[:2], tmp_path / "results/tables.md.kept")] == ["mine"] * 3


def test_what_is_in_the_way_of_a_run_gets_another_name(request_of, run):
    for name in ("record.json", "prediction.json"):
        (run.folder / name).unlink()
    (run.folder / "record.json").mkdir()
    (run.folder / "record.json" / "notes.txt").write_text("mine")
    evaluate(request_of())
    assert (run.folder / "record.json").is_file()
    assert (run.folder / "record.json.kept" / "notes.txt").read_text() == "mine"


def test_second_call_keeps_records_and_rescoring_gives_the_same(request_of, run, evaluated, monkeypatch, caplog):
    stamp = (run.folder / "record.json").stat().st_mtime_ns
    assert evaluate(request_of("MeanColour"))[-1] == evaluated
    assert (run.folder / "record.json").stat().st_mtime_ns == stamp
    assert "kept" in caplog.text
    monkeypatch.setattr("leaderboard.scoring.score.code_version", lambda: "of another day")
    assert score(run) == evaluated  # whose version is that of the code that trained


def test_a_run_that_another_process_is_at_is_waited_for(request_of, run, evaluated, tmp_path, caplog):
    folder = run.folder
    record, away = folder / "record.json", tmp_path / "record.json"
    taken = threading.Event()

    def finish():
        with locked(folder):
            record.rename(away)
            taken.set()
            deadline = time.monotonic() + PATIENCE
            while BUSY not in caplog.text and time.monotonic() < deadline:
                time.sleep(0.05)
            away.rename(record)

    with ThreadPoolExecutor(1) as pool:
        finishing = pool.submit(finish)
        taken.wait()
        evaluate(request_of("MeanColour"))
        finishing.result()
    assert f"{folder}: {BUSY}" in caplog.text
    assert "toy_methods:MeanColour on yard/streak-0, seed 0: kept" in caplog.text


def test_renders_that_were_interrupted_are_made_again(request_of, run, evaluated, tmp_path, monkeypatch):
    (run.folder / "record.json").unlink()
    with monkeypatch.context() as patch, pytest.raises(SystemExit):
        patch.setattr(predict_module, "render_views", lambda *_: sys.exit(130))
        predict_module.train_and_render(run)
    with pytest.raises(InputError, match=r"not trained to its end[\s\S]*goes on where it stopped"):
        score(run)
    assert as_row(evaluate(request_of("MeanColour"))[-1])["psnr"] == evaluated.scores["psnr"]


CODE = (
    "hydroviews/rain/streaks.py",
    "deraings/enhancement/weights/small.safetensors",
    "hydroviews/captures/captures.toml",
    "pyproject.toml",
)
OTHER = (
    "docs/pictures/rain.jpg",
    "README.md",
    "tests/test_docs.py",
    "leaderboard/board/demo/3dgs/yard/clean/seed-0/record.json",
    "hydroviews/rain/README.md",
    ".github/workflows/ci.yml",
)


@pytest.mark.parametrize("tracked", [True, False])
def test_a_version_is_dirty_where_code_that_a_run_can_depend_on_was_changed(tmp_path, monkeypatch, tracked):
    paths = {name: tmp_path / name for name in ("hydroviews/__init__.py", *CODE, *OTHER)}
    for name, path in paths.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        if tracked or name.endswith("__init__.py"):
            path.write_text("before")
    commit(tmp_path)
    monkeypatch.setattr("leaderboard.records.hydroviews.__file__", str(paths["hydroviews/__init__.py"]))
    for name in (*CODE, *OTHER):
        assert not code_version().endswith("-dirty")
        paths[name].write_text("after")
        assert code_version().endswith("-dirty") == (name in CODE), name
        paths[name].write_text("before") if tracked else paths[name].unlink()


def commit(folder: Path) -> None:
    """Everything below a folder, in a repository of its own."""
    who = ["-c", "user.name=n", "-c", "user.email=e"]
    for command in (["init"], ["add", "."], ["commit", "--allow-empty", "-m", "all"]):
        subprocess.run(["git", "-C", str(folder), *who, *command], check=True, capture_output=True)


def test_a_version_names_the_commit_of_our_own_checkout_alone(tmp_path, monkeypatch):
    package = tmp_path / "theirs" / "site-packages" / "hydroviews"
    package.mkdir(parents=True)
    monkeypatch.setattr("leaderboard.records.hydroviews.__file__", str(package / "__init__.py"))
    assert code_version() == hydroviews.__version__
    commit(tmp_path / "theirs")  # in which somebody has installed us
    assert code_version() == hydroviews.__version__
    (package / "__init__.py").write_text("")
    commit(package.parent)
    assert re.fullmatch(re.escape(hydroviews.__version__) + r"\+[0-9a-f]{7,}", code_version())


def test_scoring_takes_the_folders_that_evaluate_takes_and_removes_what_was_half_written(
    run, evaluated, tmp_path, capsys
):
    results, written = tmp_path / "results", run.folder / "record.json"
    written.unlink()
    for folder, name in ((run.folder, "per_view.csv"), (results, "tables.md")):
        (folder / f".partial-host-0123-{name}").write_text("half")
    score_command("streak-0", method="toy_methods:MeanColour", scene="yard", data=tmp_path / "data", results=results)
    assert json.loads(written.read_text())["psnr"] == evaluated.scores["psnr"]
    assert f"PSNR {evaluated.scores['psnr']:.2f} dB" in capsys.readouterr().out
    table_command(results)
    assert not list(results.rglob(".partial-*"))


def test_a_method_that_sees_clean_views_needs_no_rain(request_of, tmp_path):
    evaluate(request_of("MeanColourClean"))
    assert list(leaderboard(tmp_path).method) == ["toy_methods:MeanColourClean"]
    assert not (tmp_path / "data/demo/yard/streak-0").exists()


def test_the_sparse_track_trains_on_a_third_and_keeps_apart(request_of, run, evaluated, tmp_path):
    record = evaluate(request_of("MeanColour", track="sparse-views"))[-1]
    table = leaderboard(tmp_path)
    assert list(table.track) == ["given-poses"] * 2 + ["sparse-views"] * 2
    assert (list(table.n_train), list(table.n_test)) == ([7, 7, 3, 3], [2] * 4)
    sparse = dataclasses.replace(run, track="sparse-views")
    assert sparse.folder == run.folder.with_name("seed-0-sparse-views")
    names = json.loads((tmp_path / "data/demo/yard/split.json").read_text())["sparse"]
    seen = [read_image(tmp_path / "data/demo/yard/streak-0/images" / f"{n}.png").mean(axis=(0, 1)) for n in names]
    assert json.loads((sparse.folder / "colour.json").read_text()) == pytest.approx(np.mean(seen, axis=0), abs=1e-6)
    assert "yard (demo, sparse-views)" in outcome(record, tmp_path / "results")
    tables = (tmp_path / "results/tables.md").read_text()
    for track in ("given-poses", "sparse-views"):
        assert f"## yard (demo, {track})" in tables
    assert score(sparse).n_train == 3


def test_a_task_says_by_its_status_whether_its_run_failed(request_of, run, evaluated, tmp_path):
    task.main(run, Limits(1, 1))  # is done
    with pytest.raises(SystemExit) as ended:
        task.main(dataclasses.replace(run, method="toy_methods:Raises"), Limits(1, 1))
    assert ended.value.code == 1


def test_other_settings_are_refused_unless_overwritten(request_of, run, monkeypatch):
    monkeypatch.setenv("TOY_SHIFT", "0.1")
    sys.modules.pop("toy_methods", None)
    with pytest.raises(InputError, match=r"other settings[\s\S]*--overwrite"):
        evaluate(request_of("MeanColour"))
    assert evaluate(request_of("MeanColour", overwrite=True))[-1].status == "done"
    assert json.loads((run.folder / "config.json").read_text())["config"] == {"shift": 0.1}
    stamp = (run.folder / "record.json").stat().st_mtime_ns
    evaluate(request_of("MeanColour", overwrite=True))  # the same settings: kept
    assert (run.folder / "record.json").stat().st_mtime_ns == stamp
    (run.folder / "config.json").unlink()
    with pytest.raises(InputError, match="other settings"):
        evaluate(request_of("MeanColour"))


@pytest.mark.parametrize(
    ("method", "changes", "message"),
    [
        ("MeanColour", {"profile": "huge"}, "no such profile"),
        ("MeanColour", {"track": "my-poses"}, r"no such track[\s\S]*given-poses, sparse-views"),
        ("MeanColour", {"scene": "/nowhere"}, "SCENE=/nowhere: no such folder"),
        ("MeanColour", {"patterns": ("hail-0",)}, "no such rain pattern"),
        pytest.param("MeanColour", {"data": Path("/proc")}, "no folder can be made there", marks=LINUX),
        ("OddConfiguration", {}, r"OddConfiguration: no configuration for PROFILE=demo[\s\S]*no settings today"),
        ("HoldsAnObject", {}, r"HoldsAnObject: its configuration cannot be recorded\n.*schedule is object"),
    ],
)
def test_what_cannot_be_evaluated_is_refused_before_anything_is_built(request_of, tmp_path, method, changes, message):
    with pytest.raises(InputError, match=message):
        evaluate(request_of(method, **changes))
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize(
    ("method", "message"),
    [
        ("json:JSONDecoder", "is not a method"),
        ("module_that_exits:Any", r"cannot import[\s\S]*SystemExit: 0"),
        ("module_that_dies:Any", r"cannot be imported[\s\S]*ended before the work was done, with exit status 0"),
    ],
)
def test_unknown_methods(method, message, tmp_path, monkeypatch):
    monkeypatch.setattr(evaluate_module, "probe", probe)
    monkeypatch.setenv("PYTHONPATH", str(Path(finished_runs.__file__).parents[1] / "processes"))
    with pytest.raises(InputError, match=message):
        evaluate(EvaluateRequest(method=method, data=tmp_path, results=tmp_path))
