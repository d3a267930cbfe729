"""Speed against error. Each part is a command, `python -m benchmarks.NAME`, and keeps freed memory as others do."""

from hydroviews.files.malloc import keep_freed_memory

keep_freed_memory()
