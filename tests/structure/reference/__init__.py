# SPDX-License-Identifier: GPL-3.0-or-later

"""Pages that say what the code says: made from the parsers, tables and definitions that the programs themselves use.

`python -m tests.structure.reference` (or `make reference`) writes all of them anew; a test says when one is out of
date. Nothing is described here: a word that is missing belongs beside the thing that it describes.
"""
