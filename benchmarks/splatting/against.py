"""A step of training here against the same step in another checkout, in turns on one machine.

    python -m benchmarks against --other CHECKOUT
    python -m benchmarks against --other CHECKOUT --simd avx2 --threads 1 2

Wall-clock times want an idle machine; the ratio is between medians of steps that alternate.
"""

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from tqdm import tqdm

from benchmarks.tables import report

HERE = Path(__file__).parents[2]
CASES = ((30_000, 320, 240), (30_000, 400, 300), (60_000, 400, 300), (200_000, 800, 600))
WARM = 3  # steps that are not counted


def main(
    other: Path,
    model: Path | None = None,
    scene: Path | None = None,
    threads: tuple[int, ...] = (1,),
    simd: tuple[str, ...] = ("",),
    repeats: int = 21,
    folder: Path = Path("results/bench"),
) -> None:
    """Measure and report, as splatting-against.csv too.

    Args:
        other: the checkout to compare with; it is run by this Python.
        model: a trained model.safetensors for one more case, at 320x240.
        scene: the built scene that it was trained on.
        threads: numbers of threads.
        simd: instructions to use here; none for the best there are.
        repeats: timed steps of each case.
        folder: where the table goes.
    """
    cases: list[tuple[str, list[str]]] = [(f"{n}, {w}x{h}", [str(n), str(w), str(h)]) for n, w, h in CASES]
    if model is not None and scene is not None:
        cases.insert(0, (f"{scene.name}, 320x240", ["0", "320", "240", str(model), str(scene)]))
    turns = [(name, case, count, kind) for kind in simd for count in threads for name, case in cases]
    rows = []
    for name, case, count, kind in tqdm(turns, desc="steps", leave=False):
        arguments = [*case[:3], str(count), *case[3:]]
        steps = alternate([(HERE, {"HYDROVIEWS_SIMD": kind}), (other, {})], arguments, repeats)
        ours, theirs = 1000 * np.median(steps[0], axis=0), 1000 * np.median(steps[1], axis=0)
        rows.append({
            "case": name, "threads": count, "simd": kind or "best", "there, ms": theirs[1], "here, ms": ours[1],
            "times faster": theirs[1] / ours[1], "of processor time": theirs[0] / ours[0],
        })  # fmt: skip
    report(pd.DataFrame(rows), folder / "splatting-against.csv")


def alternate(
    checkouts: Sequence[tuple[Path, dict[str, str]]], arguments: Sequence[str], repeats: int
) -> list[list[tuple[float, float]]]:
    """Processor and wall seconds of steps in each checkout, with these variables in its environment."""
    servers = []
    for checkout, variables in checkouts:
        environment = {**os.environ, **variables, "PYTHONPATH": str(checkout.resolve())}
        command = [sys.executable, str(Path(__file__).with_name("step_server.py")), *arguments]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        servers.append(subprocess.Popen(command, cwd=checkout, env=environment, **pipes))
    steps: list[list[tuple[float, float]]] = [[] for _ in servers]
    try:
        for server in servers:
            assert server.stdout is not None
            if server.stdout.readline().strip() != "ready":
                raise RuntimeError(f"{' '.join(map(str, server.args))}: ended before its first step")
            server.send_signal(signal.SIGSTOP)
        for _ in range(repeats + WARM):
            for server, times in zip(servers, steps, strict=True):
                times.append(one_step(server))
    finally:
        for server in servers:
            server.kill()
            server.wait()
    return [times[WARM:] for times in steps]


def one_step(server: subprocess.Popen) -> tuple[float, float]:
    """Processor and wall seconds of a step; else the server stands still, as its threads wait in busy loops."""
    assert server.stdin is not None
    assert server.stdout is not None
    server.send_signal(signal.SIGCONT)
    print(file=server.stdin, flush=True)
    cpu, wall = map(float, server.stdout.readline().split())
    server.send_signal(signal.SIGSTOP)
    return cpu, wall
