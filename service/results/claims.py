"""A service's claim on a database of PostgreSQL: two services on one database would count each window twice.

The claim is an advisory lock of the one connection that writes, so that nothing is written without it. Where that
connection is lost the next one takes the lock again; a session of the service's own that the server still takes for
alive is ended. Once another service has had the database, what this one remembers may be out of date: it writes no
more.
"""

from __future__ import annotations

import uuid
from dataclasses import dataclass, field
from typing import Any

from service.errors import StorageUnavailable

LOCK = 7_219_432  # number of the advisory lock; that of migrations is another
HOLDERS = (
    "SELECT a.pid, a.application_name FROM pg_locks l JOIN pg_stat_activity a USING (pid) "
    "WHERE l.locktype = 'advisory' AND l.granted AND l.classid = 0 AND l.objid = %s "
    "AND l.database = (SELECT oid FROM pg_database WHERE datname = current_database())"
)
ENDED_WITHIN = 5000  # that an old session of the service's own is waited for [ms]


@dataclass(slots=True, kw_only=True)
class Claims:
    """What one service claims.

    name  the database, as a person knows it
    """

    name: str
    application: str = field(default_factory=lambda: f"gear-twin service {uuid.uuid4().hex[:12]}")
    lost: bool = False  # whether another service has had the database since this one began
    held: bool = False  # whether this one has had it

    def take(self, connection: Any, _: object) -> None:
        """Takes the lock for a new connection; StorageUnavailable where another service has it, or has had it."""
        own = False
        try:
            if not self.lost and (
                _locked(connection) or ((own := self._ended_own(connection)) and _locked(connection))
            ):
                self.held = True
                return
        except BaseException:
            connection.close()
            raise
        connection.close()
        if own:
            text = f"{self.name} cannot be used now (connection lost): an earlier session of this service does not end"
            raise StorageUnavailable(text, reason="connection lost")
        self.lost = self.held
        text = f"{self.name} cannot be used now (locked): another service uses this database; give each its own"
        if self.held:
            text = (
                f"{self.name} cannot be used any more (locked): another service has used this database since the "
                "connection was lost; give each its own, and start this one again"
            )
        raise StorageUnavailable(text, reason="locked")

    def _ended_own(self, connection: Any) -> bool:
        """Ends earlier sessions of this very service that still have the lock; whether there were any."""
        with connection.cursor() as cursor:
            cursor.execute(HOLDERS, (LOCK,))
            own = [pid for pid, application in cursor.fetchall() if application == self.application]
            for pid in own:
                cursor.execute("SELECT pg_terminate_backend(%s, %s)", (pid, ENDED_WITHIN))
        connection.commit()
        return bool(own)


def _locked(connection: Any) -> bool:
    with connection.cursor() as cursor:
        cursor.execute("SELECT pg_try_advisory_lock(%s)", (LOCK,))
        (held,) = cursor.fetchone()
    connection.commit()  # the lock is the session's, not the transaction's
    return bool(held)
