"""The parts that HydroViews uses: those that a machine has, those that it lacks, and what to do about these."""

import importlib.util
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from hydroviews.blender.process import SYSTEM_PACKAGES
from hydroviews.captures.catalogue.catalogue import all_captures, captures_root, locate
from hydroviews.files.cache import cache_folder

GB = 1e9
LEAST_DISK = 2.0  # GB: a scene and its runs of the demo profile have about 0.3
LEAST_MEMORY = 4.0  # GB: a run of the demo profile takes 1 to 3
CORES = 2  # that times on pages are for
SECONDS = 60.0  # that Blender's module may take to be imported
WEIGHTS = {  # what is fetched once, by the beginning of its file's name, and its size
    "lpips": ("LPIPS weights", "64 MB are downloaded at the first score"),
    "xfeat": ("XFeat weights", "downloaded when cameras are first estimated for rainy photographs"),
}
EXTRAS = {
    "viewer": ("viser", "`leaderboard view`"),
    "compression": ("gsply", "`leaderboard export --format compressed`"),
}


class Finding(NamedTuple):
    """One thing that was looked at."""

    what: str
    state: str  # OK, LATER for what can be done without, or MISSING
    found: str
    fix: str = ""


OK, LATER, MISSING = "ok", "optional", "missing"


def doctor_command() -> None:
    """Say what this machine has, what it lacks and what to do; exit status 1 if something needed is missing."""
    found = []
    for finding in findings():
        print(f"{finding.state:8}  {finding.what:15}  {finding.found}")
        if finding.fix:
            print(f"{'':27}what to do: {finding.fix}")
        found.append(finding)
    if any(finding.state == MISSING for finding in found):
        sys.exit(1)


def findings() -> Iterator[Finding]:
    """Everything that is looked at, in the order in which a newcomer meets it."""
    yield python_version(sys.version_info[:2])
    yield blender()
    yield disk(Path.cwd())
    yield memory()
    yield speed()
    yield gpu()
    yield from weights(cache_folder())
    yield captures(captures_root(None))
    yield from extras()


def python_version(version: tuple[int, int]) -> Finding:
    """The interpreter: Blender's module exists for two versions only."""
    said = f"{platform.python_version()} at {sys.executable}"
    if version in ((3, 11), (3, 13)):
        return Finding("Python", OK, said)
    return Finding("Python", LATER, f"{said}; Blender's module needs 3.11 or 3.13", "make setup PYTHON=python3.11")


def blender() -> Finding:
    """Blender's module, imported in a process of its own: it may lack libraries, or end its process."""
    code = "import bpy; print(bpy.app.version_string)"
    without = "; `hydroviews reconstruct` works without it, water on the lens and embedded scenes do not"
    try:
        run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=SECONDS)
    except subprocess.TimeoutExpired:
        return Finding("Blender", MISSING, f"importing bpy took more than {SECONDS:g} s{without}", "try again")
    if run.returncode == 0:
        return Finding("Blender", OK, f"bpy {run.stdout.strip().splitlines()[-1]}")
    said = (run.stderr.strip() or f"exit status {run.returncode}").splitlines()[-1]
    if "No module named 'bpy'" in said:
        fix = "pip install 'hydroviews[blender]' in a Python 3.11 (or 3.13); in a clone: make setup"
        return Finding("Blender", MISSING, f"bpy is not installed{without}", fix)
    return Finding("Blender", MISSING, f"{said}{without}", f"apt-get install {SYSTEM_PACKAGES}")


def disk(folder: Path) -> Finding:
    """Space for data and results, where commands write by default."""
    free = shutil.disk_usage(folder).free / GB
    said = f"{free:.1f} GB free in {folder}"
    if free >= LEAST_DISK:
        return Finding("disk", OK, said)
    fix = "free some space, or write elsewhere: make eval DATA=... RESULTS=..."
    return Finding("disk", MISSING, f"{said}, {LEAST_DISK:g} GB are needed", fix)


def memory() -> Finding:
    """Memory of the machine."""
    total = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / GB
    if total >= LEAST_MEMORY:
        return Finding("memory", OK, f"{total:.0f} GB")
    fix = "close other programs, and train one method at a time"
    return Finding("memory", LATER, f"{total:.1f} GB; a run of the demo profile takes 1 to 3 GB", fix)


def speed() -> Finding:
    """Cores that are free: times on pages are for two."""
    from baselines.splatting.kernels.simd import available

    cores, busy = len(os.sched_getaffinity(0)), os.getloadavg()[0]
    said = f"{cores} cores, {busy:.1f} of them busy, {' '.join(available())}"
    if cores - busy >= CORES - 1:
        return Finding("processor", OK, said)
    fix = "wait until other programs are done, or expect commands to take longer; interrupted commands resume"
    return Finding("processor", LATER, f"{said}; times in the documentation are for {CORES} free cores", fix)


def gpu() -> Finding:
    """The GPU that a training would use, or the reason why it would use none."""
    from baselines.training.devices import FIX, NO_DEVICE, missing_for_cuda

    lacking = missing_for_cuda("gsplat")
    if lacking is None:
        return Finding("GPU", OK, "used for training")
    if lacking == NO_DEVICE:
        return Finding("GPU", LATER, "none; training runs on the CPU")
    return Finding("GPU", LATER, f"not used: {lacking}", FIX)


def weights(cache: Path) -> Iterator[Finding]:
    """What is downloaded once."""
    for name, (what, otherwise) in WEIGHTS.items():
        there = sorted(cache.glob(f"{name}*.safetensors"))
        yield Finding(what, OK, str(there[0].parent)) if there else Finding(what, LATER, otherwise)


def captures(root: Path) -> Finding:
    """Published captures on this machine."""
    here = [capture.name for capture in all_captures() if locate(capture, root)]
    if here:
        return Finding("captures", OK, f"{', '.join(here)} in {root}")
    return Finding("captures", LATER, f"none in {root}; embedded scenes need none", "hydroviews download lists them")


def extras() -> Iterator[Finding]:
    """Packages that single commands need."""
    for extra, (package, command) in EXTRAS.items():
        if importlib.util.find_spec(package):
            yield Finding(extra, OK, f"{package}, for {command}")
        else:
            yield Finding(
                extra, LATER, f"{package} is not installed; {command} needs it", f"pip install 'hydroviews[{extra}]'"
            )
