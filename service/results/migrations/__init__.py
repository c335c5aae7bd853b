"""The steps of the database's schema: Alembic's revisions in `versions`."""
