"""How large a fleet must be: a model of up to 10,000 assets, and real runs that it must meet.

    python -m benchmarks.fleet_simulation [--real | --sizes]

`--real` runs a fleet with the tests' twin, which sleeps 20 ms a window, at 200 and 500 assets on this machine, kills
one of its two nodes in each run, and prints what the model predicts beside what is measured. The model is given what a
run of 50 assets costs a window, what a transaction takes, how long a killed worker takes to be replaced, and how
many times longer processor time took by the wall clock meanwhile, because others use the machine.

`--sizes` measures the steps of the twin itself, cold and warm, with and without tracing, and what a window costs in a
fleet (`bench_fleet`), and prints what the model makes of it for fleets of many sizes: placement, lag of results behind
windows, what the database has to take, and the recovery after a fifth of the nodes is lost. Without an option: both.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import os
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.bench_fleet import ENGINE_GROUPS, PARTITIONS, Run
from benchmarks.fleet_model import Array, Costs, Model, Plan, Result
from benchmarks.fleet_plant import campaign
from benchmarks.fleet_real import IDLE_TIMEOUT, NODES, STEP, Found, Load, Slower, fleet
from benchmarks.fleet_real import PARTITIONS as REAL_PARTITIONS
from service.fleet.lease import LOOK_EVERY, SILENT
from service.runtime.curves import Curves, WorkerCurves, name_of, packed
from service.runtime.delivery import ASK_EVERY
from service.runtime.positions import ON_THE_WAY

CALIBRATION = Load(assets=50, period=10.0, windows=3)
REAL = (
    Load(assets=200, period=25.0, windows=4, lose_at=65.0),
    Load(assets=500, period=60.0, windows=3, lose_at=130.0),
)
IDLE = 15.0  # that is measured without frames [s]
TICK = 0.1  # between two looks of the receiving thread whether a window has closed [s]
DETECT = SILENT + LOOK_EVERY / 2  # until another host takes what a lost one had [s]

SIZES = (50, 100, 200, 500, 1000, 2000, 5000, 10_000)
PERIOD = 600.0  # of an asset's windows, of 2.5 s at 12.8 kHz [s]
CLOSE = 3.0 + TICK / 2  # the setting `idle_timeout` [s]
CORES = 4  # of a node
USED = 0.5  # share of a node's cores that the sizing fills
FIFTH = 0.2  # of the nodes, lost
LEAST_NODES = 5  # so that a fifth of them can be lost
SPAN = 2400.0  # simulated [s]
LOST_AT = 1800.0  # [s]
ASSETS_A_PLACE = 300  # of a partition, by this sizing: half of what Zenoh recovers in time
DAY = 86_400.0  # [s]


# -- steps ---------------------------------------------------------------------------------------------


def _steps(trace: bool, most: int) -> list[float]:
    """Processor times of a campaign's steps in this process, from its first window [s]."""
    from benchmarks.scoring import windows_of
    from service.contract.estimate import step
    from twin.options import Options
    from twin.state import State

    rig, windows = windows_of(campaign())
    state, options, found = State(), Options(trace=trace), []
    for window in windows[:most]:
        begun = time.process_time()
        state, _ = step(rig, state, window, options)
        found.append(time.process_time() - begun)
    return found


@dataclass(frozen=True, slots=True)
class _Kept:
    """Curves as they are kept, in memory."""

    curves: dict[str, bytes]

    def read(self, asset: str, name: str) -> bytes | None:
        return self.curves.get(name)

    def keep(self, asset: str, curves: Curves) -> None:
        """Keeps nothing more."""


def _cold(windows_before: int) -> float:
    """The first step of an asset in this process, which reads the curves that another one has kept [s]."""
    from benchmarks.scoring import windows_of
    from service.contract.estimate import step
    from twin.kept_curves import curves_of
    from twin.options import Options
    from twin.state import State
    from twin.updating.model_cache import PATHS

    rig, windows = windows_of(campaign())
    state, options = State(), Options(trace=False)
    for window in windows[:windows_before]:
        state, _ = step(rig, state, window, options)
    kept = _Kept({name_of(key): packed(path.kept) for key, path in curves_of(rig, state).items()})
    data = state.to_dict()
    PATHS.clear()
    begun = time.process_time()
    WorkerCurves(kept).at("asset", lambda asset: {})
    step(rig, State.from_dict(data), windows[windows_before], options)
    return time.process_time() - begun


@dataclass(frozen=True, slots=True, kw_only=True)
class Steps:
    """Processor times of the twin's steps [s]."""

    warm: Array  # wear alone, once an asset has been learned
    cold: Array  # wear alone, the first in a process, with the curves that another one has kept
    traced_learning: Array  # with the search for effects, while the machine is learned
    traced_later: Array


def measured_steps() -> Steps:
    """All of them, each kind in a process of its own."""
    context = multiprocessing.get_context("spawn")
    with context.Pool(1, maxtasksperchild=1) as pool:
        alone = pool.apply(_steps, (False, 30))
        traced = pool.apply(_steps, (True, 30))
        cold = [pool.apply(_cold, (count,)) for count in (10, 20, 28)]
    third = len(traced) // 2
    return Steps(
        warm=np.array(alone[third:]), cold=np.array(cold),
        traced_learning=np.array(traced[2:third]), traced_later=np.array(traced[third:]),
    )  # fmt: skip


# -- real runs -----------------------------------------------------------------------------------------


def met(found: Found, model: Result, per_window: dict[str, float], idle: dict[str, float], load: Load) -> None:
    """Prints what was predicted beside what was measured."""
    print(
        f"\n{load.assets} assets, a window each {load.period:g} s; a node lost after {load.lose_at:g} s; processor "
        f"time {found.slower:.1f} × as long by the wall clock"
    )
    print(f"{'':<42}{'predicted':>11} {'measured':>10} {'deviation':>10}")
    rows: list[tuple[str, float, float, str]] = [
        (f"lag of results behind windows, {name}", model.lag(percent), float(np.percentile(found.lags, percent)), "s")
        for name, percent in (("median", 50), ("95 %", 95), ("worst", 100))
    ]
    for name, what, unit, scale in (
        ("transactions", "transactions", "/s", 1.0), ("log", "database's log", "kB/s", 1024.0),
    ):  # fmt: skip
        expected = idle[name] + per_window[name] * found.windows / found.seconds
        rows.append((what, expected / scale, found.written[name] / found.seconds / scale, unit))
    rows.append(("last partition served after the loss", model.served, found.served, "s"))
    rows.append(("all caught up after the loss", model.drained, found.drained, "s"))
    for what, expected, is_, unit in rows:
        print(f"{what:<42}{expected:>9.2f} {unit:<5}{is_:>7.2f} {unit:<5}{100 * (is_ / expected - 1):>+6.0f} %")


def real() -> None:
    """The model beside real runs, each with a fleet of its own."""
    for load in REAL:
        with tempfile.TemporaryDirectory(prefix="gear-twin-bench-") as made, fleet(Path(made)) as running:
            idle, idle_written = running.idle(IDLE)
            calibrated = running.run(CALIBRATION)
            database = running.commit()
            watch = Slower()
            restart, processor = running.restart()
            restart_wait = max(restart - processor * watch.end(), 0.0)
            a_window = {
                name: (calibrated.written[name] - idle_written[name] * calibrated.seconds) / calibrated.windows
                for name in idle_written
            }
            own = (calibrated.spent["partition"] - idle["partition"] * calibrated.seconds) / calibrated.windows
            print(
                f"\nmeasured at {CALIBRATION.assets} assets: {1e3 * own:.1f} ms a window in the partition, "
                f"{a_window['transactions']:.1f} transactions and {a_window['log'] / 1024:.1f} kB of log a window; "
                f"{idle_written['transactions']:.1f} transactions/s without frames; one takes {1e3 * database:.1f} ms; "
                f"a killed worker replaced in {restart:.1f} s ({processor:.1f} s of processor); load "
                f"{os.getloadavg()[0]:.1f}",
                flush=True,
            )
            found = running.run(load)
        slow = found.slower
        costs = Costs(
            receive=own / 2 * slow, commit=own / 2 * slow, warm=np.zeros(1), cold=np.zeros(1), sleep=STEP,
            database=database, close=IDLE_TIMEOUT + TICK / 2, asked_every=ASK_EVERY, asking=ON_THE_WAY + TICK,
            detect=DETECT, restart=processor * slow, restart_wait=restart_wait,
        )  # fmt: skip
        plan = Plan(
            assets=load.assets, period=load.period, partitions=REAL_PARTITIONS, nodes=NODES,
            cores=os.cpu_count() or 1, seconds=load.seconds, lose_at=load.lose_at, lose=1,
        )  # fmt: skip
        met(found, Model(plan, costs).run(), a_window, idle_written, load)


# -- sizes ---------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class Fleets:
    """What a window and a second cost in a fleet."""

    own: float  # processor time of the partition a window [s]
    over_step: float  # processor time of what computes, beyond the step [s]
    engine: float  # of a node a second [s]
    partition: float  # of a partition a second [s]
    server: float  # processor time of the database a window [s]
    transactions: float  # a window
    log: float  # a window [bytes]
    transactions_idle: float  # of a partition a second
    partition_memory: float  # [bytes]
    node_memory: float  # with its host and what computes there [bytes]
    commit: float  # one transaction that reaches the disk [s]
    restart: float  # processor time of a partition's start [s]
    restart_wait: float  # of the same, without a core [s]


def measured_fleet(steps: Steps, restart: tuple[float, float], commit: float) -> Fleets:
    """By a short run of `bench_fleet`."""
    with tempfile.TemporaryDirectory(prefix="gear-twin-bench-") as made:
        run = Run(Path(made), 2, 1)
        run.all()
    a_window = run.of_a_window(run.fleet)
    memory = {name: each[2] for name, each in run.memory.items()}
    seconds, processor = restart
    return Fleets(
        own=a_window["partition"],
        over_step=max(a_window["fleet computing"] - float(np.mean(steps.warm)), 0.0),
        engine=sum(run.idle[name] for name in ENGINE_GROUPS),
        partition=run.idle["partition"] / PARTITIONS,
        server=a_window["server"],
        transactions=a_window["transactions"],
        log=a_window["log"],
        transactions_idle=run.idle["transactions"] / PARTITIONS,
        partition_memory=memory["partition"] / PARTITIONS,
        node_memory=memory["node"] + memory["host"] + memory["computing"],
        commit=commit,
        restart=processor,
        restart_wait=max(seconds - processor, 0.0),
    )


def costs_of(steps: Steps, fleets: Fleets) -> Costs:
    """What the model is given."""
    return Costs(
        receive=fleets.own / 2, commit=fleets.own / 2, warm=steps.warm + fleets.over_step,
        cold=steps.cold + fleets.over_step,
        database=fleets.commit, close=CLOSE, asked_every=ASK_EVERY, asking=ON_THE_WAY + TICK, detect=DETECT,
        restart=fleets.restart, restart_wait=fleets.restart_wait,
    )  # fmt: skip


def plan_of(assets: int, busy: float) -> Plan:
    """Partitions and nodes for so many assets, where a window costs so much processor time [s]."""
    partitions = max(4, math.ceil(assets / ASSETS_A_PLACE))
    nodes = math.ceil(assets / PERIOD * busy / (CORES * USED))
    return Plan(
        assets=assets, period=PERIOD, partitions=partitions, nodes=max(nodes, 1), cores=CORES, seconds=SPAN,
    )  # fmt: skip


def sizes(steps: Steps, fleets: Fleets) -> None:
    """Prints the model's table."""
    costs = costs_of(steps, fleets)
    busy = fleets.own + float(np.mean(costs.warm))
    print(
        f"\nmodel: wear alone, a window of 2.5 s at 12.8 kHz each {PERIOD:g} s, {CORES} cores a node, of which at most "
        f"{100 * USED:.0f} % are used\n"
        f"{'assets':>7}{'windows/day':>13}{'partitions':>11}{'nodes':>6}{'cores used':>11}{'memory GB':>10}"
        f"{'lag median':>11}{'95 %':>7}{'worst':>7}{'trans./s':>9}{'log kB/s':>9}"
        f"{'served':>7}{'caught up':>10}"
    )
    for assets in SIZES:
        plan = plan_of(assets, busy)
        result = Model(plan, costs).run()
        nodes = max(plan.nodes, LEAST_NODES)
        lost = Model(
            replace(plan, nodes=nodes, lose_at=LOST_AT, lose=max(1, round(FIFTH * nodes))), costs
        ).run()  # fmt: skip
        rate = assets / PERIOD
        used = rate * (busy + fleets.server) + plan.nodes * fleets.engine + plan.partitions * fleets.partition
        memory = (plan.partitions * fleets.partition_memory + plan.nodes * fleets.node_memory) / 2**30
        transactions = rate * fleets.transactions + plan.partitions * fleets.transactions_idle
        print(
            f"{assets:>7,}{rate * DAY:>13,.0f}{plan.partitions:>11}{plan.nodes:>6}{used:>11.2f}{memory:>10.1f}"
            f"{result.lag(50):>11.2f}{result.lag(95):>7.2f}{result.lag(100):>7.2f}{transactions:>9.1f}"
            f"{rate * fleets.log / 1024:>9.0f}"
            f"{lost.served:>7.1f}{lost.drained:>10.1f}"
        )
    traced = float(np.sum(steps.traced_learning))
    print(
        f"tracing, beyond wear alone: {traced:.0f} s of processor for an asset's first {steps.traced_learning.size} "
        f"windows, then {1e3 * float(np.mean(steps.traced_later)):.0f} ms a window; 10,000 assets that all begin "
        f"on one day: {10_000 * traced / 3600:.0f} core-hours"
    )


def main(what: str | None) -> None:
    """Prints everything."""
    print(f"load {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores", flush=True)
    if what != "sizes":
        real()
    if what == "real":
        return
    steps = measured_steps()
    for name in ("warm", "cold", "traced_learning", "traced_later"):
        values: Array = 1e3 * getattr(steps, name)
        print(f"step, {name.replace('_', ' '):<18} {np.median(values):>8.0f} ms median, {max(values):.0f} worst")
    with tempfile.TemporaryDirectory(prefix="gear-twin-bench-") as made, fleet(Path(made)) as running:
        commit, restart = running.commit(), running.restart()
    fleets = measured_fleet(steps, restart, commit)
    print(fleets)
    sizes(steps, fleets)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fleet_simulation", description=__doc__)
    group = parser.add_mutually_exclusive_group()
    group.add_argument("--real", dest="what", action="store_const", const="real", help="the real runs alone")
    group.add_argument("--sizes", dest="what", action="store_const", const="sizes", help="the model's table alone")
    main(parser.parse_args().what)
