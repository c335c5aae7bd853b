"""The HTTP side: REST, server-sent events, metrics, the OpenAPI page and the dashboard."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

from fastapi import FastAPI
from starlette.middleware.gzip import GZipMiddleware

from service.access.access import Access
from service.alarms.keeper import AlarmKeeper
from service.api import alarms as alarm_routes
from service.api import asset_life as life_routes
from service.api import asset_list as list_routes
from service.api import assets, collector, effects, events, guard, metrics, pages, problems, reports, sessions
from service.api import audit as audit_routes
from service.api import baselines as baseline_routes
from service.api import incoming as incoming_routes
from service.api import rig_proposals as proposal_routes
from service.api import signals as signal_routes
from service.api import what_if as what_if_routes
from service.api.headers import SafeHeaders
from service.api.limits import Bounds, Limits
from service.contract import rest
from service.operation.health import Health
from service.results.alarm_store import AlarmStore
from service.results.asset_table import AssetTable
from service.results.audit_log import AuditLog
from service.results.baseline_store import BaselineStore
from service.results.job_queue import JobQueue
from service.results.jobs import Jobs
from service.results.kept_signals import KeptSignals
from service.results.names import Names
from service.results.offers import Offers
from service.results.sql_store import SqlStore

if TYPE_CHECKING:
    from service.signals.library import Library

COMPRESSED_FROM = 1000  # size from which an answer is compressed [bytes]; event streams never are
COMPRESSION = 5  # of gzip, 1 … 9: nearly as small as 9 in a third of its time
LABELLED_ASSETS = 500  # with metrics of their own
DECISION_WAIT = 30.0  # how long a decision is waited for before it is answered as waiting [s]


def create_app(
    table: AssetTable,
    store: SqlStore,
    queue: JobQueue | None = None,
    *,
    not_ready: Callable[[], str | None] = lambda: None,
    figures: Callable[[], collector.Figures] = dict,
    signals: KeptSignals | None = None,
    alarms: AlarmKeeper | None = None,
    baselines: BaselineStore | None = None,
    access: Access | None = None,
    limits: Limits | None = None,
    audit: AuditLog | None = None,
    incoming: incoming_routes.Incoming | None = None,
    labelled_assets: int | None = LABELLED_ASSETS,
    health: Health | None = None,
    unserved: Callable[[], Sequence[int]] | None = None,
) -> FastAPI:
    """The app over the table of assets and its store.

    queue      where people's jobs are submitted; None where nobody carries them out: they are kept
    not_ready  why the service takes no frames yet, or None
    figures    of the process for /metrics, by their names in the catalogue: `queue_frames`, …
    signals    raw signals of windows; None where none are kept
    alarms     whoever keeps alarms; None for one over the store, with the default rules
    baselines  healthy baselines of single assets; None where none are kept
    access     whom it lets in; None for clients of this computer alone
    limits     what one client may ask of it; None for the usual ones, under any name
    audit      where changes are entered; None for the store's database
    incoming   what is known of the network's side; None for a service that adopts every asset
    labelled_assets  so many have metrics of their own; None where there are no metrics of assets
    health     the loops of the process; None where there are none
    unserved   the partitions of a fleet that nobody serves; None where this is no fleet
    """
    app = FastAPI(
        title="gear-twin",
        version=_version(),
        summary="Digital twin of gear wear: vibration in, wear depth and remaining life out",
        docs_url=None,
        redoc_url=None,
    )
    app.state.table, app.state.store, app.state.not_ready = table, store, not_ready
    app.state.signals = signals
    app.state.health = health or Health()
    app.state.library = None if signals is None else _library(signals, store, table)
    app.state.alarms = alarms or AlarmKeeper(AlarmStore(store.database))
    app.state.names, app.state.offers = Names(store.database), Offers(store.database)
    app.state.baselines = baselines
    app.state.unserved = unserved
    app.state.incoming = incoming or incoming_routes.Incoming()
    app.state.queue = queue or JobQueue(Jobs(store.database))
    app.state.decision_wait = DECISION_WAIT if queue else 0.0
    app.state.access = admitted = access or Access()
    app.state.audit = log = audit or AuditLog(store.database)
    counts: Counter[str] = Counter()

    def figures_of_all() -> collector.Figures:
        own = (figures, app.state.offers.figures, admitted.figures, log.figures)
        return {name: value for part in own for name, value in part().items()} | {"http_refused": dict(counts)}

    app.state.registry = collector.registry(table, app.state.queue.jobs, figures_of_all, labelled_assets)
    problems.install(app)
    app.add_middleware(GZipMiddleware, minimum_size=COMPRESSED_FROM, compresslevel=COMPRESSION)
    app.add_middleware(Bounds, limits=limits or Limits(), counts=counts)
    app.add_middleware(problems.Faults)
    app.add_middleware(SafeHeaders)
    for module in (alarm_routes, assets, effects, events, signal_routes, metrics, pages, reports, what_if_routes):
        app.router.routes += module.router.routes  # as they are: `include_router` would make each once more
    for module in (list_routes, life_routes, baseline_routes, sessions, audit_routes, incoming_routes, proposal_routes):
        app.router.routes += module.router.routes
    pages.mount_static(app)
    guard.install(app, audit_routes.refused)
    _describe(app)
    return app


def _describe(app: FastAPI) -> None:
    """Adds problems, credentials and roles to the description of the interface."""
    generate = app.openapi

    def openapi() -> dict[str, Any]:
        schema = generate()
        problem = rest.Problem.model_json_schema(ref_template="#/components/schemas/{model}")
        schema["components"]["schemas"].setdefault("Problem", problem)
        guard.described(schema, app)
        return schema

    app.openapi = openapi  # type: ignore[method-assign]


def _library(signals: KeptSignals, store: SqlStore, table: AssetTable) -> Callable[[], Library]:
    """The views of the windows that are kept, made when somebody first asks for one."""

    @cache
    def opened() -> Library:
        from service.signals.library import Library  # loads half of the twin, which a start does without

        return Library(signals, store, table)

    return opened


def _version() -> str:
    try:
        return version("gear-twin")
    except PackageNotFoundError:  # run from the source tree
        return "0+source"
