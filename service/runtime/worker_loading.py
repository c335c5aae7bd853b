"""What the server of worker processes loads once: shared by all workers, which the collector leaves alone.

A worker's collector would otherwise write to what it looks through, and each worker would soon have its own copy.
"""

from service.long_lived import long_lived

with long_lived():
    import service.contract.estimate
    import service.runtime.worker_task  # noqa: F401
