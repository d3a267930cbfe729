"""Speed against error: `python -m benchmarks NAME`. Benchmarks keep freed memory as the commands do."""

from hydroviews.cli.malloc import keep_freed_memory

keep_freed_memory()
