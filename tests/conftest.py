"""Its folder is on Python's path, so that tests of any room can name ``plain_parts:Class``."""
