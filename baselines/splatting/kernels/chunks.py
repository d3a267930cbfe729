"""How Gaussians, and what is made of them, are shared out to threads: in fixed parts, so that results are too.

Gaussians are cut into CHUNKS contiguous chunks. Projection writes the visible ones of a chunk one after the other from
the chunk's first *slot* on, a slot having the number of a Gaussian; the slots between two chunks' ends are left as they
are. A share of the work is every SHARES-th chunk, since neighbours are often out of sight together.
"""

CHUNKS = 64
SHARES = 8
