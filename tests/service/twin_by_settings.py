"""`gear-twin serve` with the twin itself, by the settings, run as a program by tests."""

from __future__ import annotations

from fake_twin import JOINED

if __name__ == "__main__":  # the service is not imported before: worker processes import this file
    from one_partition import serve

    from service.configuration.load import load
    from service.runtime.by_settings import twin_of

    serve(twin_of(load()), JOINED)
