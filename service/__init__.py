"""The edges of gear-twin: streams, recordings, the database, REST and the command line.

One window's arrays are small: linear algebra on several threads waits for itself more than it works (the features
of one window take 17 ms on one thread, 60 ms on two of a busy machine). The libraries read how many threads they
may use when numpy is first imported, and every edge is imported through this file, so it is said here, once.
A value from the environment is kept.
"""

import os

for _library in ("OPENBLAS", "OMP", "MKL"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

# A proxy knows nothing of this computer's own addresses: webhooks, traces and commands ask them directly.
_direct = os.environ.get("no_proxy") or os.environ.get("NO_PROXY") or ""
if _direct.strip() != "*":
    _hosts = dict.fromkeys([*filter(None, _direct.split(",")), "localhost", "127.0.0.1", "::1"])
    os.environ["NO_PROXY"] = os.environ["no_proxy"] = ",".join(_hosts)

__version__ = "0.1.0"
