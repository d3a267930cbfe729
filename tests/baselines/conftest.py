import sys
from pathlib import Path

from gsplat_stand_in import cuda_backend  # noqa: F401
from kernel_fixtures import compiled_kernels, one_thread, one_torch_thread  # noqa: F401

sys.path.insert(0, str(Path(__file__).parent))
