"""The windows that are kept, ready to be looked at: subjects and views, computed once for all who ask.

One view is computed at a time: the twin's own windows go first on a machine with few cores, and whoever asks for what
is being computed gets it from here.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from service.results.asset_table import AssetTable
from service.results.kept_signals import KeptSignals
from service.results.signal_thinning import KeptWindow
from service.results.sql_store import SqlStore
from service.signals.subject import Modelling, Subject, modelling
from service.signals.view import View, ViewOptions
from service.signals.views import VIEWS
from service.signals.waterfall import Row, Waterfall, row_of, waterfall
from service.stream.window import laid_out
from twin.errors import NotAvailable, TwinError
from twin.features.window_features import WindowFeatures
from twin.rig import Rig

if TYPE_CHECKING:  # views of what is measured need no twin
    from twin.state import State
    from twin.tracing.modelled_lines import ModelledLines

SUBJECTS, KEPT_VIEWS, ROWS, MODELS = 4, 8, 600, 64
T = TypeVar("T")


class Recent(Generic[T]):
    """The values that were asked for most recently."""

    def __init__(self, most: int) -> None:
        self._most, self._values = most, OrderedDict[Hashable, T]()

    def get(self, key: Hashable, make: Callable[[], T]) -> T:
        if key in self._values:
            self._values.move_to_end(key)
            return self._values[key]
        value = make()
        self._values[key] = value
        while len(self._values) > self._most:
            self._values.popitem(last=False)
        return value


class Library:
    """Views of all assets' windows."""

    def __init__(self, signals: KeptSignals, store: SqlStore, table: AssetTable) -> None:
        self._signals, self._store, self._table = signals, store, table
        self._lock = threading.RLock()
        self._windows: Recent[Subject] = Recent(SUBJECTS)
        self._views: Recent[View] = Recent(KEPT_VIEWS)
        self._rows: Recent[Row | str] = Recent(ROWS)
        self._states: Recent[State | None] = Recent(2)
        self._models: Recent[ModelledLines | str] = Recent(MODELS)

    def kept(self, asset: str) -> tuple[KeptWindow, ...]:
        """What is kept of an asset, by number."""
        return self._signals.kept(asset)

    def subject(self, asset: str, index: int, modelled: bool = True) -> Subject:
        """One window; NotKept where its raw signals are not there."""
        with self._lock:
            entry = next((w for w in self.kept(asset) if w.number == index), None)
            version = self._version(asset) if modelled else None
            start = None if entry is None else entry.start_ns
            return self._windows.get((asset, index, start, version), lambda: self._subject(asset, index, modelled))

    def view(self, asset: str, index: int, name: str, options: ViewOptions, modelled: bool = True) -> View:
        """One view of a window; NotKept, UnknownChannel, TwinError."""
        with self._lock:
            subject = self.subject(asset, index, modelled)
            key = (asset, index, subject.window.start_time_ns, name, options, self._version(asset), modelled)
            return self._views.get(key, lambda: VIEWS[name](subject, options))

    def waterfall(
        self, asset: str, channel: str | None, name: str, *, rows: int, bins: int, high: float | None
    ) -> Waterfall:
        """Spectra of the windows that are kept, one a row; NotAvailable where there are none."""
        kept, rig = [w for w in self.kept(asset) if not w.refused], self._rig(asset)

        def as_it_came(window: KeptWindow) -> Subject:  # examining instruments takes longer than all else together
            found = self._signals.window(asset, window.number, rig, laid_out)
            return Subject(asset=asset, index=window.number, window=found, rig=rig)

        def row(window: KeptWindow) -> Row | str:
            key = (asset, window.number, window.start_ns, channel, name)
            with self._lock:
                return self._rows.get(key, lambda: row_of(as_it_came(window), channel, name))

        return waterfall(kept, row, name, rows=rows, bins=bins, high=high, rig=rig)

    def _rig(self, asset: str) -> Rig:
        snapshot = self._table.get(asset)
        return Rig.from_mapping((snapshot.rig if snapshot else None) or {})

    def _version(self, asset: str) -> Any:
        """What changes whenever the twin of an asset, or what is known of its machine, does."""
        snapshot = self._table.get(asset)
        return None if snapshot is None else (snapshot.windows_total, snapshot.last_event_id)

    def _subject(self, asset: str, index: int, modelled: bool) -> Subject:
        rig = self._rig(asset)
        window = self._signals.window(asset, index, rig)
        model: Modelling | None = None
        why = ""
        if modelled:
            from twin.updating.update import NEEDED

            try:
                rig.require("a model of this machine", *NEEDED)
                model = self._modelling(asset, index, rig)
                why = "" if model else "the twin of this machine has no model yet"
            except NotAvailable as error:
                why = str(error)
        return Subject(asset=asset, index=index, window=window, rig=rig, model=model, no_model=why)

    def _modelling(self, asset: str, index: int, rig: Rig) -> Modelling | None:
        version = self._version(asset)
        state = self._states.get((asset, version), lambda: self._state(asset))
        if state is None:
            return None
        own = modelling(rig, state, lambda: self._recorded_um(asset, index))

        def lines(features: WindowFeatures) -> ModelledLines:
            def solve() -> ModelledLines | str:
                try:
                    return own(features)
                except TwinError as error:
                    return str(error)

            found = self._models.get((asset, index, features.start_time_ns, version), solve)
            if isinstance(found, str):
                raise NotAvailable(found)
            return found

        return lines

    def _state(self, asset: str) -> State | None:
        """The twin's state; None where there is none, or it is another twin's."""
        from twin.state import State

        stored = self._store.asset(asset).state
        try:
            return None if stored is None else State.from_dict(stored)
        except (TwinError, ValueError):
            return None

    def _recorded_um(self, asset: str, index: int) -> float | None:
        """The depth in the window's record [µm]."""
        found = self._store.windows(asset, index - 1, 1)
        return found[0].record.get("wear_depth_um") if found and found[0].record["index"] == index else None
