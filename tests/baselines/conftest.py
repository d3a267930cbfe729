import sys
from pathlib import Path

from kernel_fixtures import compiled_kernels, one_thread, one_thread_for_what_is_shared  # noqa: F401
from pretended_gpu import cuda_backend, pretended_gpu  # noqa: F401

sys.path.insert(0, str(Path(__file__).parent))
