"""The first lines of a command, before its imports: those take a second or more, and signals may come meanwhile.

It imports nothing of ours, so that nothing takes long before it.
"""

import os
import signal

# How often a thread of libgomp looks for work before it sleeps; 300,000 is usual. Beside two other processes on two
# cores a training takes 43 steps a second instead of 20, and on an idle machine about 95 instead of 98.
SPINS = "10000"
ENDED = "\nended by {}; the same command goes on from here"


def begin() -> None:
    """Let this process end at once, without a traceback of its imports, until `commands.run_command` takes over.

    Threads that wait for others soon sleep, which leaves cores to other processes.

    OpenCV keeps its own words on damaged files to itself, here and in processes that this one starts: our errors name
    the file.
    """
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    os.environ.setdefault("GOMP_SPINCOUNT", SPINS)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, _end)


def _end(number: int, _: object) -> None:
    os.write(2, (ENDED.format(signal.Signals(number).name) + "\n").encode())
    os._exit(128 + number)
