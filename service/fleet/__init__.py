"""Many machines: any number of hosts with the roles of `gear-twin serve`, over one database of PostgreSQL.

Needs the extra `gear-twin[fleet]`; nothing else in the service imports this package.
"""
