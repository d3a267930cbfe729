from kernel_fixtures import compiled_kernels, one_thread, one_torch_thread  # noqa: F401
from pretended_gpu import pretended_gpu  # noqa: F401
