"""The command line: exit status 0 done, 2 input that cannot be used (one line says why), 1 an internal error."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from service.printable import printable

EXTRAS = {
    "numba": "analysis",
    "plotly": "analysis",
    "psycopg": "postgresql",
    "pyarrow": "formats",
    "paho": "mqtt",
    "asyncua": "opcua",
    "opentelemetry": "telemetry",
    "ray": "fleet",
    "obstore": "fleet",
}
"""Packages that an installation may leave out, and the extra that has them."""


def run(arguments: Sequence[str]) -> int:
    """Runs one command; answers its exit status."""
    from service.cli.commands import app
    from service.errors import DeliveryError, InputError, InputErrors, SteppedBack
    from twin.errors import ParameterError

    try:
        status = app(args=list(arguments) or ["--help"], prog_name="gear-twin", standalone_mode=False)
        return status if isinstance(status, int) else 0
    except InputErrors as error:
        return max(_fail(line, 2) for line in error.lines)
    except SteppedBack as error:
        return _fail(str(error), 1)
    except (InputError, ParameterError) as error:
        return _fail(str(error), 2)
    except DeliveryError as error:
        return _fail(str(error), 1)
    except KeyboardInterrupt:
        return _fail("interrupted", 130)
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package not in EXTRAS:
            raise
        line = f"this command needs the package {package}, which is not installed here"
        return _fail(f"{line}: make install, or pip install 'gear-twin[{EXTRAS[package]}]'", 2)
    except Exception as error:
        if type(error).__name__ == "Abort":
            return _fail("interrupted", 130)
        if type(error).__name__ == "NoArgsIsHelpError":  # a group without a command: its help was printed
            return 0
        if not hasattr(error, "format_message"):  # what the argument parser raises has it
            raise
        return _fail(f"{error.format_message()} (see gear-twin --help)", 2)


def _fail(message: str, status: int) -> int:
    line = printable(" ".join(message.split()))
    print(f"gear-twin: {line}", file=sys.stderr)
    return status
