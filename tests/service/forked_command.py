"""`gear-twin` of the documentation's tests: a client of the server in `forked_processes`, which runs the command.

    python -I -S forked_command.py FD ARGUMENT ...        FD: the way to the server

It hands its directory, environment, input and output on, passes signals on, and ends as the command does.
"""

import json
import os
import signal
import socket
import struct
import sys

NUMBER = struct.Struct("i")
asked = {"module": "service", "arguments": sys.argv[2:], "environment": dict(os.environ), "folder": os.getcwd()}
said, ends = os.pipe()
with socket.socket(fileno=int(sys.argv[1])) as server:
    socket.send_fds(server, [json.dumps(asked).encode()], [0, 1, 2, ends])
os.close(ends)
(number,) = NUMBER.unpack(os.read(said, NUMBER.size))
for each in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
    signal.signal(each, lambda given, _: os.kill(number, given))
(status,) = NUMBER.unpack(os.read(said, NUMBER.size))
status = os.waitstatus_to_exitcode(status)
if status < 0:
    signal.signal(-status, signal.SIG_DFL)
    os.kill(os.getpid(), -status)
sys.exit(status)
