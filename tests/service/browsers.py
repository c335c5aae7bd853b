"""What tests of the page do with a browser under the page's own content security policy."""

from __future__ import annotations

import time
from functools import partial


def under_policy(page):
    """The page, whose `wait_for_function` evaluates no text in the page, which its policy forbids."""
    page.wait_for_function = partial(_wait_for_function, page)
    return page


def _wait_for_function(page, expression, *, arg=None, timeout=30_000):
    deadline = time.monotonic() + timeout / 1000
    while not page.evaluate(expression, arg):
        assert time.monotonic() < deadline, f"{expression} is not true after {timeout} ms"
        page.wait_for_timeout(20)
