"""A CUDA toolkit that is none."""

from pathlib import Path


def program(path: Path, script: str) -> Path:
    """An executable shell script."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)
    return path


def toolkit(home: Path, version: str = "13.0", otherwise: str = "exit 1") -> Path:
    """A folder with a header, and an nvcc that says its version, and does something else when asked to compile."""
    said = f'case "$*" in --version) echo "Cuda compilation tools, release {version}, V{version}.88"; exit;; esac'
    program(home / "bin" / "nvcc", f"{said}\n{otherwise}")
    header = home / "include" / "cuda_runtime.h"
    header.parent.mkdir(parents=True, exist_ok=True)
    header.touch()
    return home
