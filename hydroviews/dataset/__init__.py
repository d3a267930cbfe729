"""The data set on disk: build, open, verify, describe.

sources.py        a capture by its name or folder, built at a profile's size
suites.py         many captures in one call
build.py          one scene: clean views, then every rainy variant, then what describes them
request.py        what a scene was asked to be, kept beside it
drawing_code.py   which code drew it
clean_views.py    views, masks, depth, cameras and points that all variants share
rainy_variant.py  the views of one pattern
drop_masks.py     where drops are, for captures taken through drops
variants.py       opens what was built, comparing bytes with the manifest
lending.py        what a method may see of it, in a folder of its own
manifest.py       a SHA-256 of every file
checks/           verify.py checks all of it: files, cameras, rain; repair.py makes changed files again
statistics.py     what rain did to every view
card/             a page that describes a scene, and contact sheets of its layers
sharing/          handing it on: archives of variants
"""
