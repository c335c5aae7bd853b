"""The edges of gear-twin: streams, recordings, the database, REST and the command line."""
