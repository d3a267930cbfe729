from kernel_fixtures import compiled_kernels, one_thread, one_thread_for_what_is_shared  # noqa: F401
from pretended_gpu import pretended_gpu  # noqa: F401
