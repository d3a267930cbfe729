"""leaderboard sweep | check | table | compare | site | view | publish | board | ...; one run is `hydroviews eval`."""

from hydroviews.cli.starting import begin

if __name__ == "__main__":
    begin()

import inspect
import json
import sys
from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import Annotated

import tyro

from baselines.method import METHODS, WRAPPERS, find_method, find_wrapper
from baselines.rendering.film import FilmChoice
from hydroviews.cli.commands import choices, run_command
from hydroviews.cli.plugins import registered
from hydroviews.dataset.manifest import built_scenes
from hydroviews.dataset.suites import DEVELOPMENT, TEST
from hydroviews.errors import InputError
from hydroviews.profiles import find_profile
from leaderboard.contract.check import MINUTES, check
from leaderboard.contract.trials import Result
from leaderboard.evaluate import figures, outcome
from leaderboard.gather import BOARD, collect_views, is_board, read_leaderboard, write_leaderboard
from leaderboard.publishing.board_pages import write_board
from leaderboard.publishing.publish import publish
from leaderboard.records import GIVEN_POSES, LEADERBOARD
from leaderboard.runs.run import Run
from leaderboard.runs.run_options import MethodName, PatternNames, ProfileName, TrackName
from leaderboard.scoring.score import score
from leaderboard.scoring.submission import submit
from leaderboard.site.write import write_site
from leaderboard.sweep.sweep import SweepRequest, sweep
from leaderboard.tables.comparison import compare
from leaderboard.tables.comparison import in_words as comparison_text
from leaderboard.tables.dataframes import of_suite, scene_keys, suite_blocks
from leaderboard.tables.markdown import block_title, legend, scene_text, suite_title
from leaderboard.tables.rain_losses import numbers_for_grades, record_losses
from leaderboard.tables.table_files import TABLES
from leaderboard.viewer.export import Format, export
from leaderboard.viewer.film import film
from leaderboard.viewer.viewer import HOST, PORT, view

DATA = Path("data")  # where `make eval` builds

SuiteName = Annotated[str, choices((TEST, DEVELOPMENT))]


def sweep_command(request: tyro.conf.OmitArgPrefixes[SweepRequest]) -> None:
    """Run a matrix of methods, scenes, patterns and seeds. Finished runs are skipped, missing scenes are built."""
    failures = sweep(request)
    for run, reason in failures.items():
        print(f"{run}: failed: {reason}")
    if not request.slurm and (request.results / TABLES).is_file():
        print(f"tables: {request.results / TABLES}; `leaderboard site` shows them with pictures")
    if failures:
        sys.exit(1)


def check_command(
    method: tyro.conf.Positional[MethodName],
    profile: ProfileName = "demo",
    steps: int = 30,
    minutes: float = MINUTES,
    json: Path | None = None,
) -> None:
    """Test on a small room whether a method keeps the contract: a line per check; exit status 1 if one fails.

    Args:
        method: a registered name, or package.module:Class.
        profile: the profile whose configuration is shortened.
        steps: number of training steps, if the configuration counts steps; interrupted trainings take a few seconds.
        minutes: time limit of a check.
        json: a file for the results of the checks.
    """
    if any(outcome.result == Result.FAILED for outcome in check(method, profile, steps, json, minutes)):
        sys.exit(1)


def methods_command() -> None:
    """List the methods, and the wrappers that change a method, as in 3dgs+enhance."""
    found: dict[str, object] = {name: find_method(name) for name in registered(METHODS)}
    found |= {f"NAME+{name}": find_wrapper(name) for name in registered(WRAPPERS)}
    width = max(map(len, found))
    for name, documented in found.items():
        print(f"{name:{width}}  {_first_line(documented)}")


def _first_line(documented: object) -> str:
    return (inspect.getdoc(documented) or "").partition("\n")[0]


def table_command(results: Path = Path("results"), suite: SuiteName = "", cards: Path | None = None) -> None:
    """Gather all records into leaderboard.csv, per_view.csv and tables.md, and print the tables.

    Args:
        results: the results folder.
        suite: print only the scenes of this suite.
        cards: a data folder, or a built scene in one. Writes the PSNR that plain 3DGS loses into the data cards.
    """
    table = of_suite(write_leaderboard(results), suite)
    for keys in scene_keys(table):
        print(f"\n{scene_text(table, *keys)}", end="")
    print(f"\n{legend()}")
    if not is_board(results):
        print(f"all runs: {results / LEADERBOARD}")
    if cards:
        enter_losses(cards, results)


def enter_losses(data: Path, results: Path) -> None:
    """Enter what plain 3DGS loses to each variant into the cards of built scenes, and print it.

    Args:
        data: a data folder, or a built scene in one.
        results: with leaderboard.csv.

    Raises:
        InputError: a scene has no runs; the others have their losses entered.
    """
    failures = []
    for folder in built_scenes(data):
        try:
            losses = record_losses(folder, results)
            print(f"{folder.name}\n{losses.to_string(index=False)}")
            numbers = numbers_for_grades(folder, losses)
            print(f"measured, for its capture.json: {json.dumps(numbers)}\n" if numbers else "")
        except InputError as error:
            failures.append(str(error))
    if failures:
        raise InputError("\n".join(failures))


def site_command(results: Path = Path("results"), data: Path = DATA) -> None:
    """Write all runs as pages that open from disk without a network: tables, ranks, plots, pictures side by side.

    Args:
        results: the results folder.
        data: folder that the scenes were built in, for rainy and clean views.
    """
    if is_board(results):
        raise InputError(f"{results}: the board that ships", fix="`leaderboard board` writes its pages elsewhere")
    print(f"open {write_site(write_leaderboard(results), results, data)}")


def compare_command(
    methods: tuple[str, ...] = (),
    metric: str = "psnr",
    suite: SuiteName = "",
    patterns: PatternNames = (),
    profile: ProfileName = "demo",
    track: TrackName = GIVEN_POSES,
    results: Path = Path("results"),
) -> None:
    """Compare methods on the runs that all of them have: means, differences, 95 % intervals, significance, ties.

    Args:
        methods: names of methods, as in tables. Default: first all methods with enough runs, then all methods on the
            runs that every method has.
        metric: psnr, ssim, lpips_alex, lpips_vgg, or a registered metric.
        suite: compare only on this suite. Default: on each suite separately.
        patterns: compare only in these patterns. Default: in all patterns.
        profile: profile of the runs.
        track: track of the runs.
        results: the results folder.
    """
    table = of_suite(read_leaderboard(results), suite)
    table = table[(table.profile == profile) & (table.track == track)]
    table = table[table.pattern.isin(patterns)] if patterns else table
    if table.empty:
        raise InputError(f"{results}: no such run", expected=", ".join([profile, track, *patterns]))
    views = collect_views(table, results)
    texts, failures = [], []
    for keys, found in suite_blocks(table).items():
        for block in found[: 1 if methods else None]:
            title = block_title(", ".join([suite_title(*keys), *patterns]), block)
            try:
                compared = compare(table.loc[block.rows.index], views, metric, methods)
                texts.append(comparison_text(compared, title))
            except InputError as error:  # a suite that cannot be compared does not hold up the others
                texts.append(f"{title}\n\n{error}\n")
                failures.append(str(error))
    if len(failures) == len(texts):
        raise InputError("\n".join(dict.fromkeys(failures)))
    print(*(f"\n{text}" for text in texts), sep="", end="")


def publish_command(
    results: Path = Path("results"),
    board: Path = BOARD,
    submitted: bool = False,
    overwrite: bool = False,
    data: Path = Path("data"),
) -> None:
    """Copy all trusted runs onto the board that ships, done or failed: records, scores of views, three small renders.

    Renders are copied on the scenes that this project draws, with the views that the runs were given.

    Args:
        results: folder of the runs.
        board: folder of the board.
        submitted: copy submitted runs too.
        overwrite: replace runs on the board that differ.
        data: data folder, for the views that the runs were given.
    """
    outcome = publish(results, board, submitted, overwrite, date.today(), data)
    for name, reason in outcome.left_out.items():
        print(f"{name}: left out: {reason}")
    print(
        f"{board}: {len(outcome.written)} runs written, {outcome.kept} there already, {len(outcome.left_out)} left out"
    )


def board_command(
    board: Path = BOARD, out: Path = Path("build/board"), pages: tuple[Path, ...] = (), docs: str = ""
) -> None:
    """Write tables, comparisons and pages of published runs, and fill the tables of documents from them.

    Args:
        board: the published runs.
        out: folder for tables and pages.
        pages: Markdown files with tables between comments, as README.md has them.
        docs: address of the documentation, absolute or as seen from `site/index.html`. Default: no links to it.
    """
    print(f"open {write_board(board, out, pages, docs)}")


def score_command(
    pattern: str,
    method: MethodName = "3dgs",
    scene: str = "courtyard",
    profile: ProfileName = "demo",
    seed: int = 0,
    track: TrackName = GIVEN_POSES,
    data: Path = Path("data"),
    results: Path = Path("results"),
) -> None:
    """Score a run again from its renders, without the model.

    Args:
        pattern: such as raindrop-1; clean for a method that sees clean views.
        method: of the run.
        scene: a built scene.
        profile: of the run.
        seed: of the run.
        track: of the run.
        data: folder that `make eval` built in.
        results: folder of the runs.
    """
    run = Run(method, find_profile(profile).name, seed, data / profile, scene, pattern, results, track)
    print(f"{run}: {figures(score(run))}")


def submit_command(
    folder: tyro.conf.Positional[Path],
    data: Path = DATA,
    results: Path = Path("results"),
    overwrite: bool = False,
) -> None:
    """Score somebody's renders of held-out views, and add their rows to the tables. No code of theirs runs.

    Args:
        folder: with submission.toml and the renders.
        data: folder that the scenes were built in.
        results: folder that takes the runs.
        overwrite: replace what was submitted under that name before.
    """
    records = submit(folder, data, results, overwrite)
    for record in {(record.scene, record.track): record for record in records}.values():
        print(f"\n{outcome(record, results)}")


def view_command(run: tyro.conf.Positional[Path], data: Path = DATA, host: str = HOST, port: int = PORT) -> None:
    """Open a trained scene in a browser, with its cameras, photographs and errors.

    Args:
        run: folder of a finished run, such as results/demo/3dgs/courtyard/raindrop-1/seed-0.
        data: folder that `make eval` built in.
        host: network address of the viewer; 0.0.0.0 accepts other machines.
        port: first port to try; the next free port is used.
    """
    view(run, data, host, port)


def film_command(
    run: tyro.conf.Positional[Path],
    choice: tyro.conf.OmitArgPrefixes[FilmChoice],
    out: Path = Path("film.mp4"),
    data: Path = DATA,
) -> None:
    """Film a trained scene along a smooth path near its cameras.

    Args:
        run: folder of a finished run.
        choice: length, frame rate and size.
        out: the film, .mp4 or .webm.
        data: folder that `make eval` built in.
    """
    film(run, data, out, choice)


def export_command(
    run: tyro.conf.Positional[Path],
    out: Path,
    format: Format = "ply",
    sh_degree: int | None = None,
) -> None:
    """Write a run's Gaussians as one file for viewers.

    Args:
        run: folder of a finished run.
        out: the file, .ply.
        format: ply: looks like splats.ply; compressed: about a quarter of the size.
        sh_degree: leave out spherical harmonics above this degree.
    """
    export(run, out, format, sh_degree)


GROUPS: dict[str, dict[str, Callable[..., None]]] = {  # by what they are for
    "run": {
        "sweep": sweep_command,
        "check": check_command,
        "methods": methods_command,
        "score": score_command,
        "submit": submit_command,
    },
    "look": {
        "table": table_command,
        "compare": compare_command,
        "site": site_command,
        "view": view_command,
        "film": film_command,
        "export": export_command,
    },
    "publish": {"publish": publish_command, "board": board_command},
}


def main() -> None:
    """Entry point."""
    commands = {name: command for group in GROUPS.values() for name, command in group.items()}
    run_command(commands, prog="leaderboard", groups=GROUPS)


if __name__ == "__main__":
    main()
