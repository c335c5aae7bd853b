"""python -m recordings.generator SPEC.toml --out X.mcap [--truth X.json]"""

import argparse
import sys

from recordings.generator.deliver import simulate_file
from recordings.generator.errors import SimulationError


def main() -> int:
    """Simulates one spec's campaign; 0 done, 2 the spec cannot be used."""
    parser = argparse.ArgumentParser(prog="python -m recordings.generator", description="Simulate a wear campaign.")
    parser.add_argument("spec", help="spec of the campaign (TOML)")
    parser.add_argument("--out", required=True, help="recording to write (MCAP)")
    parser.add_argument("--truth", help="where the truth goes (JSON); nowhere if left out")
    arguments = parser.parse_args()
    try:
        simulate_file(
            arguments.spec, arguments.out, arguments.truth,
            lambda share, what: print(f"{100 * share:3.0f} %  {what}", file=sys.stderr),
        )  # fmt: skip
    except SimulationError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
