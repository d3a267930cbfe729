"""Handing a data set on: an archive for every variant, which can be checked and used without anything else.

archive.py     the archive: files stored one after another, and the manifest they are compared with
contents.py    what belongs to one variant, and what its licence allows
croissant.py   metadata that other software reads
pack.py        variants to archives
fetch.py       archives, from a server or a disk, into a data folder
"""
