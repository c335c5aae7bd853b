"""All benchmarks, one after the other, and at the end what was found beside what is aimed at.

    python -m benchmarks [--quick]

Ends with a non-zero status where a figure is beyond its limit (twice its aim where none is stated): that is no noise.
`--quick` leaves the hour-long recording at six minutes, and tracing, many machines and a fleet out.
"""

from __future__ import annotations

import argparse
import sys

from benchmarks import (
    bench_dynamics,
    bench_fleet,
    bench_ingest,
    bench_pipeline,
    bench_running,
    bench_store,
    bench_tracing,
)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="All benchmarks in one run.")
    parser.add_argument(
        "--quick",
        action="store_true",
        help="a long recording of six minutes; no tracing, one machine, no fleet",
    )
    chosen = parser.parse_args()
    bench_dynamics.main()
    print()
    figures = bench_pipeline.main(minutes=6.0 if chosen.quick else 60.0)
    figures += bench_ingest.figures(bench_ingest.measured(20, 4, 25_600.0, 40.0))
    figures += bench_store.figures(
        bench_store.compared(bench_store.made, bench_store.actions, (2000, 50_000), 15)
        | bench_store.compared(bench_store.plant, bench_store.lists, (200, 10_000), 15)
    )
    for figure in figures[-2:]:
        print(figure.line)
    if not chosen.quick:
        print()
        figures += bench_tracing.main()
        print()
        figures += bench_running.main()
        print()
        figures += bench_fleet.main()
    missed = [figure for figure in figures if figure.missed]
    for figure in missed:
        print(f"beyond its limit: {figure.what} {figure.value:.3g} {figure.unit}, aim {figure.aim:g}", file=sys.stderr)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
