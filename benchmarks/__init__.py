"""Speed against error. Each part is a command, `python -m benchmarks.NAME`, and minds memory as the others do."""

from hydroviews.memory import keep_freed_memory

keep_freed_memory()
