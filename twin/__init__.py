"""The simulation core of gear-twin: physics and estimation, pure functions of arrays and numbers.

Nothing in here opens a file or a socket, reads a clock, starts a thread or draws.
"""
