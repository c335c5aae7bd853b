"""Many machines: partitions of assets, each served by the pipeline of `gear-twin serve`, placed and restarted by Ray.

Needs the extra `gear-twin[fleet]`; nothing else in the service imports this package.
"""
