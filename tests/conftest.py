"""For all tests: one thread a process, as the command line has it; set before any numerical library is loaded.

This folder is on Python's path, so that tests of any room can name ``plain_parts:Class``.
"""

import os

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"
