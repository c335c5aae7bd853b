"""Alembic's revisions, from the schema of the last release before them; only ever append."""
