"""Fixtures of the answering side: a store and a board in a directory of their own."""

from __future__ import annotations

import socket
import threading
import time
from contextlib import contextmanager

import pytest
import uvicorn

from service.api import create_app
from service.results.board import Board
from service.results.sqlite_store import SqliteStore


@pytest.fixture
def store(tmp_path):
    with SqliteStore(tmp_path / "twin.sqlite") as opened:
        yield opened


@pytest.fixture
def board():
    shown = Board()
    yield shown
    shown.close()


@contextmanager
def serving(board, store):
    """The app over a real socket; yields its address."""
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        port = listening.getsockname()[1]
        config = uvicorn.Config(create_app(board, store), log_level="warning", timeout_graceful_shutdown=3)
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
        thread.start()
        try:
            while not server.started:
                assert thread.is_alive(), "the server did not start"
                time.sleep(0.01)
            yield f"http://127.0.0.1:{port}"
        finally:
            board.close()
            server.should_exit = True
            thread.join(10)
            assert not thread.is_alive(), "the server did not stop"


@pytest.fixture
def address(store, board):
    with serving(board, store) as where:
        yield where
