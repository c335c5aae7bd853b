"""The edges of gear-twin: streams, recordings, the database, REST and the command line.

One window's arrays are small: linear algebra on several threads waits for itself more than it works (the features
of one window take 17 ms on one thread, 60 ms on two of a busy machine). The libraries read how many threads they
may use when numpy is first imported, and every edge is imported through this file, so it is said here, once.
A value from the environment is kept.
"""

import os

for _library in ("OPENBLAS", "OMP", "MKL"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

__version__ = "0.1.0"
