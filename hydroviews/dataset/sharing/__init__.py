"""Handing a data set on: an archive for every variant, which can be checked and used without anything else.

archive.py     the archive: files stored one after another, and the manifest they are compared with
contents.py    what belongs to one variant, and what its licence allows
croissant.py   metadata that other software reads
pack.py        variants to archives
download.py    an archive from a server
fetch.py       archives into a data folder
fetched.py     what was fetched is used without its capture
"""
