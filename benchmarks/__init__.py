"""Speed against error. Each part is a command, `python -m benchmarks.NAME`, that ends as all commands do."""

import sys

from hydroviews.cli.starting import begin
from hydroviews.files.malloc import keep_freed_memory

if sys.argv[0] == "-m":  # Python looks for the benchmark that it is to run
    begin()
keep_freed_memory()
