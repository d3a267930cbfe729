"""The first lines of a command, before its imports: those take a second or more, and signals may come meanwhile.

It imports nothing of ours, so that nothing takes long before it.
"""

import os
import signal
import time
from pathlib import Path

# How often a thread of libgomp looks for work before it sleeps; 300,000 is usual. On an idle machine of two cores a
# training takes about 95 steps a second with 10,000 and 85 with none; beside two other processes 43 and 54.
SPINS, SPINS_IF_BUSY = "10000", "0"
LOAD, LOOKS, PAUSE = Path("/proc/loadavg"), 5, 0.004  # how often to look who runs, and seconds between
ENDED = "\nended by {}; the same command goes on from here"


def begin() -> None:
    """Let this process end at once, without a traceback of its imports, until `commands.run_command` takes over.

    Threads that wait for others soon sleep, and at once where other processes run: that leaves cores to them.

    OpenCV keeps its own words on damaged files to itself, here and in processes that this one starts: our errors name
    the file.
    """
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    if "GOMP_SPINCOUNT" not in os.environ:
        os.environ["GOMP_SPINCOUNT"] = SPINS_IF_BUSY if others_run(os.cpu_count() or 1) else SPINS
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, _end)


def others_run(cores: int, load: Path = LOAD) -> bool:
    """True if other threads run, or wait for a core, at least one for two cores; False if the system does not count.

    A busy machine is looked at a few times. The load average would remember the command before this one for minutes.
    """
    try:
        for _ in range(LOOKS):
            if 2 * (int(load.read_text().split()[3].partition("/")[0]) - 1) < cores:
                return False
            time.sleep(PAUSE)
    except (OSError, IndexError, ValueError):
        return False
    return True


def _end(number: int, _: object) -> None:
    os.write(2, (ENDED.format(signal.Signals(number).name) + "\n").encode())
    os._exit(128 + number)
