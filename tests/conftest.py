import os
import signal
import sys
from pathlib import Path

# What is promised to the bit is promised on the CPU; tests of a GPU say so themselves.
os.environ.setdefault("HYDROVIEWS_DEVICE", "cpu")

# Not tests/ itself: it has folders named like the packages.
sys.path.insert(0, str(Path(__file__).parent / "helpers"))

# Background jobs of a shell start with Ctrl-C ignored, and so would every process that a test starts and interrupts.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Tests start hundreds of processes: what one has compiled of Python, the next ones read.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
