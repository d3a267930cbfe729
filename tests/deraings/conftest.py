from kernel_fixtures import compiled_kernels, one_thread  # noqa: F401
